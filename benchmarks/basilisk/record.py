"""A wheel record made by an outside simulator: Basilisk's reaction wheel with friction, written as a sample table.

Runs in a separate environment with Basilisk (`bsk`); it uses nothing of rwa_monitor. See `make outside`.

    python record.py crossing|rest OUT.csv OUT.toml

*crossing*: the wheel is in motion from the start and crosses zero speed several times. Basilisk's friction is then
Coulomb and viscous only. *rest*: it starts from rest with the Stribeck option on; until its speed first returns to zero
its friction has a Stribeck peak.
"""

import sys
from pathlib import Path

import numpy as np
from Basilisk.architecture import messaging
from Basilisk.simulation import reactionWheelStateEffector, spacecraft
from Basilisk.utilities import SimulationBaseClass, macros, simIncludeRW

PERIOD_S = 0.125
DURATION_S = 2500.0
INERTIA = 0.0117  # kg m²
COULOMB_NM, STATIC_NM, VISCOUS = 1.6e-3, 2.6e-3, 5.3e-6  # N m, N m, N m s/rad
STRIBECK_RAD_S = 4.0  # Basilisk's betaStatic
NOISE_NM = 3.9e-5  # of the friction torque
SPEED_NOISE_RAD_S = 0.01
TORQUE_CONSTANT = 0.032  # N m/A


def motor_torque_Nm(time_s: float, case: str) -> float:
    """Return the commanded torque: slow swings through zero, or a slow spin-up from rest."""
    if case == "crossing":
        return 6.0e-3 * np.cos(2 * np.pi * time_s / 600.0)
    return 2.65e-3 + 1.2e-3 * (1 - np.cos(2 * np.pi * time_s / 1500.0)) / 2


def simulate(case: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Run Basilisk; return time [s], wheel speed [rad/s] and commanded motor torque [N m]."""
    simulation = SimulationBaseClass.SimBaseClass()
    process = simulation.CreateNewProcess("process")
    process.addTask(simulation.CreateNewTask("task", macros.sec2nano(PERIOD_S)))
    hub = spacecraft.Spacecraft()
    hub.hub.mHub = 1.0e4
    hub.hub.IHubPntBc_B = [[1e6, 0, 0], [0, 1e6, 0], [0, 0, 1e6]]  # heavy: the body hardly turns
    factory = simIncludeRW.rwFactory()
    wheel = factory.create(
        "custom",
        [1, 0, 0],
        Omega=3000.0 if case == "crossing" else 0.0,  # rpm
        Omega_max=6000.0,
        Js=INERTIA,
        u_max=0.1,
        useRWfriction=True,
        useMinTorque=False,
        fCoulomb=COULOMB_NM,
        fStatic=STATIC_NM,
        betaStatic=STRIBECK_RAD_S if case == "rest" else -1.0,
        cViscous=VISCOUS,
    )
    del wheel
    effector = reactionWheelStateEffector.ReactionWheelStateEffector()
    factory.addToSpacecraft("wheel", effector, hub)
    command = messaging.ArrayMotorTorqueMsg()
    effector.rwMotorCmdInMsg.subscribeTo(command)
    simulation.AddModelToTask("task", effector)
    simulation.AddModelToTask("task", hub)
    log = effector.rwOutMsgs[0].recorder()
    simulation.AddModelToTask("task", log)
    payload = messaging.ArrayMotorTorqueMsgPayload()
    simulation.InitializeSimulation()
    steps = int(DURATION_S / PERIOD_S)
    torque = np.zeros(steps)
    for k in range(steps):
        torque[k] = motor_torque_Nm(k * PERIOD_S, case)
        payload.motorTorque = [torque[k]]
        command.write(payload, macros.sec2nano(k * PERIOD_S))
        simulation.ConfigureStopTime(macros.sec2nano(k * PERIOD_S))
        simulation.ExecuteSimulation()
    return np.arange(steps) * PERIOD_S, np.array(log.Omega)[:steps], torque


def main() -> None:
    """Write the record and its wheel file."""
    case, table, wheel_file = sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3])
    time_s, speed, torque = simulate(case)
    # The torque of step k acts from sample k to k+1; friction over that step is the part that does not accelerate.
    friction = torque[1:-1] - INERTIA * np.diff(speed)[1:] / PERIOD_S
    middle = 0.5 * (speed[1:-1] + speed[2:])
    rng = np.random.default_rng(1)
    friction = friction + NOISE_NM * rng.standard_normal(friction.size)
    measured = middle + SPEED_NOISE_RAD_S * rng.standard_normal(middle.size)
    columns = np.column_stack([time_s[1:-1], measured, friction, torque[1:-1] / TORQUE_CONSTANT])
    header = "time_s,speed_rad_s,friction_torque_Nm,motor_current_A"
    np.savetxt(table, columns, delimiter=",", header=header, comments="", fmt="%.9g")
    wheel_file.write_text(
        f'[wheel]\nname = "basilisk"\nsample_period_s = {PERIOD_S}\ninertia_kg_m2 = {INERTIA}\n'
        f"torque_constant_Nm_A = {TORQUE_CONSTANT}\n"
    )


if __name__ == "__main__":
    main()
