"""Files that are written whole, and files from outside that are read with care."""
