"""From types to machine code, and from machine code to a million members."""
