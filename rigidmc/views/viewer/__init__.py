"""A result as one HTML page in which its members turn: `rigidmc view`, `ds.rigid.view()`."""
