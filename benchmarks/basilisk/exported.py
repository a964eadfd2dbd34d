"""Runs an exported wheel in Basilisk: its message must give the fitted law, its module the exact friction.

Runs in a separate environment with Basilisk (`bsk`); it uses nothing of rwa_monitor. See `make outside`.

    python exported.py FOLDER        # what `rwa-monitor export WHEEL.toml --to basilisk -o FOLDER` wrote

Exit code 1 where a result differs.
"""

import sys
from pathlib import Path

import numpy as np
from Basilisk.architecture import messaging
from Basilisk.simulation import reactionWheelStateEffector, spacecraft
from Basilisk.utilities import SimulationBaseClass, macros, simIncludeRW

sys.path.insert(0, str(Path(sys.argv[1]).resolve()))
import rwa_friction_basilisk as exported

PERIOD_S = 0.125
DURATION_S = 2000.0
INERTIA = 0.0117  # kg m²
BODY_INERTIA = 1e6  # kg m²
# Tolerance, of the Coulomb friction: the logged friction is that of a Runge-Kutta step's last stage, the logged speed
# that of its end; they differ most where the Stribeck peak is steep.
WITHIN = 1e-9
EXACT_WITHIN = 1e-12  # of the largest speed: 16,000 roundings of 1e-16, most of which cancel


def motor_torque_Nm(time_s: float) -> float:
    """Return the commanded torque: from rest up, and slow swings through zero."""
    return 6.0e-3 * np.sin(2 * np.pi * time_s / 800.0)


def simulate(exact: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Run Basilisk; return the speed at each step, and its log: speed [rad/s] and friction [N m]."""
    simulation = SimulationBaseClass.SimBaseClass()
    process = simulation.CreateNewProcess("process")
    process.addTask(simulation.CreateNewTask("task", macros.sec2nano(PERIOD_S)))
    hub = spacecraft.Spacecraft()
    hub.hub.mHub = 1.0e4
    hub.hub.IHubPntBc_B = (BODY_INERTIA * np.eye(3)).tolist()
    factory = simIncludeRW.rwFactory()
    message = {} if exact else exported.MESSAGE
    factory.create(
        "custom", [1, 0, 0], Omega=0.0, Omega_max=6000.0, Js=INERTIA, u_max=0.1,
        useRWfriction=not exact, useMinTorque=False, **message,
    )  # fmt: skip
    effector = reactionWheelStateEffector.ReactionWheelStateEffector()
    factory.addToSpacecraft("wheel", effector, hub)
    command = messaging.ArrayMotorTorqueMsg()
    if exact:
        friction = exported.FrictionTorque()
        friction.ModelTag = "friction"
        friction.speedInMsg.subscribeTo(effector.rwSpeedOutMsg)
        friction.commandInMsg.subscribeTo(command)
        effector.rwMotorCmdInMsg.subscribeTo(friction.commandOutMsg)
        simulation.AddModelToTask("task", friction, 100)
    else:
        effector.rwMotorCmdInMsg.subscribeTo(command)
    simulation.AddModelToTask("task", effector)
    simulation.AddModelToTask("task", hub)
    log, speeds = effector.rwOutMsgs[0].recorder(), effector.rwSpeedOutMsg.recorder()
    simulation.AddModelToTask("task", log)
    simulation.AddModelToTask("task", speeds)
    payload = messaging.ArrayMotorTorqueMsgPayload()
    simulation.InitializeSimulation()
    for k in range(int(DURATION_S / PERIOD_S)):
        payload.motorTorque = [motor_torque_Nm(k * PERIOD_S)]
        command.write(payload, macros.sec2nano(k * PERIOD_S))
        simulation.ConfigureStopTime(macros.sec2nano(k * PERIOD_S))
        simulation.ExecuteSimulation()
    return np.array(speeds.wheelSpeeds)[:, 0], np.array(log.Omega), -np.array(log.frictionTorque)


def by_hand(commands: int) -> np.ndarray:
    """Return the speed [rad/s] of a wheel whose torque less exact friction is held over each step."""
    friction, speed, before, angle = exported.Friction(), 0.0, 0.0, 0.0
    speeds = []
    for k in range(commands):
        angle += 0.5 * (speed + before) * PERIOD_S
        torque = friction.torque(speed, (speed - before) / PERIOD_S, angle, 20.0, PERIOD_S)
        before = speed
        if k > 0:  # Basilisk's first call is at time zero, and moves nothing
            # The body turns in the opposite direction, and a wheel's speed is relative to it.
            speed += PERIOD_S * (motor_torque_Nm(k * PERIOD_S) - torque) * (1 / INERTIA + 1 / BODY_INERTIA)
        speeds.append(speed)
    return np.array(speeds)


def main() -> int:
    """Print both comparisons and return the exit code."""
    speed, _, _ = simulate(exact=True)
    hand = by_hand(speed.size)
    apart = float(np.max(np.abs(speed - hand)) / np.max(np.abs(hand)))
    print(f"exact module: {apart:.1e} of the largest speed from the same steps by hand")
    _, speed, friction = simulate(exact=False)
    message = exported.MESSAGE
    moving = np.abs(speed) > 1.0
    law = np.sign(speed) * message["fCoulomb"] + message["cViscous"] * speed
    if message["betaStatic"] > 0:
        first = np.arange(speed.size) < np.argmax(speed > 30.0)  # speeding up from rest
        ratio = speed / message["betaStatic"]
        peak = (message["fStatic"] - message["fCoulomb"]) * np.exp(0.5 - 0.5 * ratio * ratio) * ratio
        law = np.where(first, peak + message["fCoulomb"] * np.tanh(10 * ratio) + message["cViscous"] * speed, law)
    off = float(np.max(np.abs(friction - law)[moving])) / message["fCoulomb"]
    print(f"fitted message: {off:.1e} of fCoulomb from its law at the logged speeds")
    return 0 if apart < EXACT_WITHIN and off < WITHIN else 1


if __name__ == "__main__":
    sys.exit(main())
