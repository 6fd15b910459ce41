"""Pictures of results and of the report."""
