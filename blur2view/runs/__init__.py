"""Many photographs: jobs in order, and what does them."""
