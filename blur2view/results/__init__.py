"""What is written: JSON documents, tables, pictures, the HTML report."""
