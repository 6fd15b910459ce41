"""Many photographs: jobs, the processes that do them, and the manifest that a later call goes on from."""
