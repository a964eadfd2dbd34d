"""The blind suite: effects hidden in records by formulas written a second time, and required to be found."""
