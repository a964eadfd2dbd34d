"""The forward model: the wheel, its friction as a sum of effects, duration laws, simulated telemetry with its truth."""
