"""How often the check at a window's close detects an effect that the model lacks, and how often it is wrong."""
