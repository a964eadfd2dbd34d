"""The four stages of the paper, one file each, and the window that runs them in order."""
