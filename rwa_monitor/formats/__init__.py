"""Files in and out: sample tables, wheel and model files, labels and truth."""
