"""Processes, threads and what users see of their progress.

`threads` (persistent threads and their tasks), `helpers` (processes that this package starts),
`progress` (what a long command says), `import_hook` (set up a library when it is imported).
"""
