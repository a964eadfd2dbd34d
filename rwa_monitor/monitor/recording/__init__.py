"""Recordings: MCAP files from which every decision of the monitor can be replayed.

In: messages and the monitor's state. Out: files that follow each other, and their content, as far as it passes its
checksums. Read `recorder.py` (their sequence, one file, recordings written again), `reader.py` (one file, or those of a
folder).
"""
