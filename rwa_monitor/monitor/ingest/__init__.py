"""What arrives, put in order: messages by publisher and number, samples into slots.

In: messages of the bus. Out: pieces of samples with their slots, each sample accounted for. Read `backfill.py` (gaps
are asked for), `sequencer.py` (messages), `slot_assignment.py` (samples).
"""
