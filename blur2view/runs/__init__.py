"""Many photographs: jobs, what does them, and the loop that gives their outcomes in order."""
