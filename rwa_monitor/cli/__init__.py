"""The command line: each command parses, calls the rooms below, prints. Nothing else happens here."""
