"""How often diagnoses of labelled windows are right, beside the paper and oracles: `make benchmark-accuracy`."""
