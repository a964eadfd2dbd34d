"""The blind suite: effects are hidden in records by an independent set of formulas; the search must find them."""
