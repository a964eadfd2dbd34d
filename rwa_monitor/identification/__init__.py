"""A wheel learned from recordings of it: nominal friction, noise, switching systems and their duration laws."""
