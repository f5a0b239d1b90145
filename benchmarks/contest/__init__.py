"""The suite: the synthesized controller against every baseline on every plant, its records, tables, charts and page.

Processes that measure one plant import this package, so each room is imported where it is needed.
"""
