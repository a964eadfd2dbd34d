"""The health page: what the monitors of a fleet report, live and recorded, in a browser.

In: messages of the bus, and the history. Out: the page (`static/`), REST, one WebSocket, metrics, …/health. Read
`listener.py` (what comes in), `fleet.py` (the latest of each wheel), `feed.py` (what goes out), `app.py` and
`server.py`.
"""
