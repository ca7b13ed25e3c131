"""Scene files: conversion of TOML text to the parts of a scene, and back.

A file contains data and executes nothing. Each error names the file, the table, the key, and the
nearest valid word. Reading order: `read` (tables to parts), `bodies` (the table [body]), `values`
(numbers, distributions and grids), `columns` (of data files, one row per member), `write` (a scene
as text, from which `read` makes the same scene).

Invariant: a file that can be read once can be read for ever, with the same members.
"""
