"""The engine: declared stages, addresses, plan, store, scheduler, command line. It knows no 3D."""

if __name__ != "b23d.pipeline":
    raise ImportError(
        f"{__name__}: expected to be imported as b23d.pipeline, got another name; write `from b23d.pipeline …`"
    )
