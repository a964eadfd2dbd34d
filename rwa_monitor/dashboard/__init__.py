"""The health page: what the monitors of a fleet say, live and recorded, in a browser."""
