"""The record of a photograph: what its JSON and the tables say of it, in words as well."""
