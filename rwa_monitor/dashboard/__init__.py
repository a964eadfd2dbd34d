"""The health page: what the monitors of a fleet report, live and recorded, in a browser.

Input: messages of the bus, and the history. Output: the page (`static/`), REST, one WebSocket, metrics, …/health. Read
`fleet.py` (the latest messages of each wheel), `feed.py` (messages to the pages and from the bus), `app.py` and
`server.py`.
"""
