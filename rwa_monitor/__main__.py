"""`python -m rwa_monitor` is the command `rwa-monitor`, for where it is not on the path."""

from rwa_monitor.cli.main import main

main()
