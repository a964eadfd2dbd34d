"""`python -m rwa_monitor` runs the command `rwa-monitor` where that is not on the path."""

from rwa_monitor.cli.main import main

main()
