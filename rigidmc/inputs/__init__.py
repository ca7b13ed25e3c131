"""Inputs: from what users hand over to plain numbers in SI units.

`units` (of numbers), `measured` ("10 deg/s", quantities of other packages), `amounts` (1e6,
"1h30m"), `arrays` (positional input), `labelled` (pandas, xarray), `synonyms` (words for hints in
messages).
"""
