"""Surfaces as the report shows them: `display`, with electrical values carried to the wall."""
