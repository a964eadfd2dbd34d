"""Every table and figure of the paper, measured again: `rwa-monitor benchmark paper`."""
