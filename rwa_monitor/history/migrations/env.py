"""Alembic's environment: runs the revisions on the connection that it is given (`history.database`)."""

from alembic import context

from rwa_monitor.history.tables import Table

context.configure(
    connection=context.config.attributes["connection"],
    target_metadata=Table.metadata,
    render_as_batch=True,  # SQLite cannot change a table in place
)
with context.begin_transaction():
    context.run_migrations()
