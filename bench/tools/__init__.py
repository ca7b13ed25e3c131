"""Tools of maintainers: counts, fingerprints, mutants, claims, tables and pictures of pages."""
