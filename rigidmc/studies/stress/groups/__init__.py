"""Groups of hard cases. A group is a module with TITLE and cases(); a new one is one file here
and one line in `rigidmc.studies.stress.case`."""
