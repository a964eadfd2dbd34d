"""The health page: what the monitors of a fleet report, live and recorded, in a browser.

In: messages of the bus, and the history. Out: the page (`static/`), REST, one WebSocket, metrics, …/health. Read
`fleet.py` (the latest of each wheel), `feed.py` (what goes out, what comes in), `app.py` and
`server.py`.
"""
