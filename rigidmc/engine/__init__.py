"""From types to machine code, and from machine code to millions of members."""
