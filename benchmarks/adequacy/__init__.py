"""How often the model check at a window's close detects an effect that the model lacks, and its false-alarm rate."""
