"""The sweep that compares estimators of F."""
