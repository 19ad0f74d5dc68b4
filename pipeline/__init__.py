"""The engine: declared stages, addresses, plan, store, scheduler, command line. It knows no 3D."""
