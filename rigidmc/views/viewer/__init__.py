"""One HTML page in which the members of a result turn: `rigidmc view`, `ds.rigid.view()`."""
