"""Replay of a bad day: the monitor was killed, messages came twice, late and broken; every decision can be made again.

    python examples/replay_bad_day.py [RECORDING]

Takes the reference recording of the checkout unless it is given another file or folder.
"""

import sys
from pathlib import Path

import rwa_monitor as rwa

# Not public, so it may change: it gives the messages of a recording one by one. Their samples alone are rwa.read(file).
from rwa_monitor.monitor.telemetry_files import read_telemetry

folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[1] / "replay" / "bad_day"

# 1. The chain of files that the recorder wrote; each names the one before it.
files = sorted(folder.glob("*.mcap")) if folder.is_dir() else [folder]
print(f"{folder.name}: {', '.join(file.name for file in files)}")

# 2. The same inputs through the same core: are changepoints and diagnoses what was recorded?
print(f"replayed: {rwa.replay(folder).short()}")

# 3. What became of every sample of the first file, by hand: a Monitor takes the messages as they came.
content = read_telemetry(files[0])
for telemetry in content.telemetry:
    monitor = rwa.Monitor(telemetry.constants, content.model, spacecraft=telemetry.spacecraft, name=telemetry.wheel)
    diagnoses = [d for batch in telemetry.batches for d in monitor.feed(batch.samples, batch.publisher, batch.batch)]
    print(f"\n{telemetry.spacecraft}/{telemetry.wheel}: {dict(monitor.counts)}")
    for diagnosis in diagnoses:
        print(f"  {diagnosis.verdict}, coverage {diagnosis.coverage:.1%}: {diagnosis.reason}")
