"""Charts, tables and the page."""
