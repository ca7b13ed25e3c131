"""A result or a scene looked at: in words, pictures, `ds.rigid`."""
