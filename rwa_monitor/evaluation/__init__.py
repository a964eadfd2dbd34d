"""How good the diagnosis is: labelled windows through the monitor, figures beside the paper's and an oracle's."""
