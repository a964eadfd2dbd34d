"""A hidden effect: data show a torque that the simulation lacks; find it, extend the model, measure the gain.

python examples/hidden_effect.py
"""

from pathlib import Path

import rwa_monitor as rwa

# 1. "Measured" data of a wheel with an effect that the model lacks. The manoeuvre matters: this one sweeps the
#    whole speed range both ways and dwells, so that causes can be separated.
truth = rwa.Scenario.from_toml(
    """
    [scenario]
    duration_s = 2500.0
    [speed]
    kind = "rich"
    [[effect]]
    name = "viscous_asymmetry"
    parameters = { strength_Nm_s_rad = 4.0e-7 }
    """,
    "hidden",
)
wheel = rwa.read_wheel()
measured = rwa.simulate(truth, wheel, seed=11).samples

# 2. What does the simulation get wrong?
search = rwa.find_discrepancy(measured, wheel)
result = search.result
print(f"\nverdict: the model is {result.verdict}")
for effect in result.effects:
    print(f"cause: {effect.name}, p = {effect.p_value:.1e}, equivalent to: {', '.join(effect.equivalent) or '-'}")
    for name, parameter in effect.parameters.items():
        print(f"  {name} = {parameter.value:.4g} ± {parameter.std or 0.0:.1g} {parameter.unit}")

# 3. The gain, on blocks of the record that the fit has not seen.
gain = result.gain
if gain is not None:
    print(f"held-out RMSE {1e6 * gain.rmse_base_Nm:.2f} → {1e6 * gain.rmse_extended_Nm:.2f} µN m")
    print(f"false jumps go away: {gain.changepoints_base} → {gain.changepoints_extended}")

# 4. The extended wheel is a wheel like any other. On new data of the same wheel nothing is left to find.
extended = rwa.extended_wheel(search)
Path("extended_wheel.toml").write_text(extended.to_toml(), encoding="utf-8")
later = rwa.simulate(truth, wheel, seed=12).samples
print(f"with extended_wheel.toml, on a later record: {rwa.find_discrepancy(later, extended).result.verdict}")
rwa.plot.discrepancy(search).savefig("discrepancy.png", dpi=110)
print("drawn: discrepancy.png")
