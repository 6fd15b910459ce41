"""Reading photographs: files, folders, lists, videos."""
