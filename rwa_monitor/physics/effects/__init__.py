"""The catalogue of effects, one file each; `catalogue.py` collects them."""
