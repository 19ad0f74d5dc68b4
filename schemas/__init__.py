"""What a stage takes and gives: one pydantic model per artifact, which is also the on-disk format."""

if __name__ != "b23d.schemas":
    raise ImportError(
        f"{__name__}: expected to be imported as b23d.schemas, got another name; write `from b23d.schemas …`"
    )
