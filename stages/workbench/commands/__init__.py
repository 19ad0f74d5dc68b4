"""Verbs and exporters that know 3D. They plug into the command line by the entry-point groups `b23d.commands` and
`b23d.exporters`."""
