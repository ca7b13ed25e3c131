"""Maps of the package. A map is a function that returns a `MapCase`; a new one is one file here
and one line in `rigidmc.studies.stability_map.case`."""
