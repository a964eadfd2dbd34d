"""What the project measures of itself: each folder or file is one question, and a target of the Makefile runs it."""
