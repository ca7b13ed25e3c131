"""The shipped maps. A map is a function that returns a `MapCase`; a new map needs one file here and
one line in `rigidmc.studies.stability_map.case`."""
