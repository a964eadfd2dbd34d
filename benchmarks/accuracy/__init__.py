"""How often diagnoses of labelled windows are right, compared with the paper and oracles: `make benchmark-accuracy`."""
