"""Blocks of members in WebAssembly, for pages and for tests."""
