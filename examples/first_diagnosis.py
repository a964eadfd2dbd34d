"""First diagnosis: a day of a wheel whose cage begins to fail, window by window.

    python examples/first_diagnosis.py

Reads no file: the telemetry is simulated. With your own, `samples = rwa.read("today.csv")` takes its place.
"""

import rwa_monitor as rwa

# 1. What happens to the wheel: from the third hour on, switching system 2 (an oil pocket, a cage) makes larger jumps.
scenario = rwa.Scenario.from_toml(
    """
    [scenario]
    duration_s = 40000.0          # four windows of 10,000 s
    [anomalies.fss_2]
    factor = 1.8
    onset_s = 18000.0
    """,
    "a day in orbit",
)
wheel = rwa.read_wheel()  # the built-in wheel; rwa.read_wheel("wheel.toml") reads yours
samples = rwa.simulate(scenario, wheel, seed=7).samples
print(f"{len(samples)} samples of speed and friction torque, {samples.time_ns[-1] / 3.6e12:.1f} hours")

# 2. The diagnosis of each window: rwa.diagnose takes a table; a rwa.Monitor takes samples in any cut, as from a bus.
diagnoses = rwa.diagnose(samples, wheel)
for number, diagnosis in enumerate(diagnoses, start=1):
    print(f"\nwindow {number}: {diagnosis.verdict}. {diagnosis.reason}")
    for name, anomaly in diagnosis.anomalies.items():
        print(f"  {name:8} probability {anomaly.probability:.3f}")
    jumps = [f"{jump.fss} {1e3 * jump.jump_Nm:+.2f} mN m" for jump in diagnosis.changepoints[:4]]
    print(f"  {len(diagnosis.changepoints)} jumps, the first: {', '.join(jumps)}")

# 3. The picture.
rwa.plot.window(samples, diagnoses[-1], wheel).savefig("last_window.png", dpi=110)
print("\ndrawn: last_window.png")
