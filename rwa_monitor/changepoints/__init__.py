"""Stage 1, detection: where the friction of a window jumps (windowed GLR), and stage 2, the levels between jumps.

In: speed and friction, block by block. Out: `Evidence` with running sums, noise and candidates; levels and slope.

Read `stage_results.py` first: what the stages hand to each other. Then `running_sums.py`, `noise.py`;
`evidence.py` runs them sample by sample, and chooses the candidates at a window's close; `estimation.py` is stage 2;
`tuning.py` is for people.
"Errata 9" and the like are rows of the table in docs/theory.md.
"""
