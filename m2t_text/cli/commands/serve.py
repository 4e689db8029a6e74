"""The command `serve`."""

from pathlib import Path
from typing import Annotated

import typer

from m2t_text.cli.compiling import compile_beside
from m2t_text.cli.console import print_lines
from m2t_text.cli.options import DEFAULT_INDEX, IndexOption
from m2t_text.errors import M2TError


def serve(
    context: typer.Context,
    index: IndexOption = DEFAULT_INDEX,
    host: Annotated[
        str,
        typer.Option("--host", metavar="HOST", help="Where to listen; others are asked for a token."),
    ] = "127.0.0.1",
    port: Annotated[
        int | None,
        typer.Option("--port", min=0, max=65535, metavar="N", show_default="8010, or the next that is free"),
    ] = None,
    name: Annotated[
        list[str] | None,
        typer.Option("--public-name", metavar="NAME", help="A name by which others reach --host; repeatable."),
    ] = None,
    open_page: Annotated[
        bool | None,
        typer.Option(
            "--open/--no-open", help="Open the page in a browser.", show_default="if there is a screen"
        ),
    ] = None,
    saved_map: Annotated[
        list[Path] | None,
        typer.Option(
            "--map", metavar="MAP.yaml", help="Show the image of a saved map where its dataset is; repeatable."
        ),
    ] = None,
    write: Annotated[bool, typer.Option("--write", help="Let the page add what is dropped on it.")] = False,
) -> None:
    """Open the page on which places are found: a building with all its maps, queries and their hits.

    It shows the index as it is, also while others write to it. Drop a log, bag, saved map or point cloud on it
    to watch it being recognised. Programs may use its HTTP interface, which /api/openapi.json describes.

    [bold]Examples[/bold]

    \b
    m2t-text serve
    m2t-text serve --index indexes/office --write      dropped logs may be added
    m2t-text serve --map floor.yaml                    its image beneath the places of dataset floor
    m2t-text serve --port 9000 --no-open               for programs
    m2t-text serve --host 0.0.0.0 --public-name robot  for others, who need the token that it prints
    """
    try:
        from m2t_text.web.serving import Serving, has_screen
        from m2t_text.web.serving import serve as run
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] not in ("starlette", "uvicorn", "anyio"):
            raise
        raise M2TError("the page needs Starlette and uvicorn: pip install 'm2t-text[web]'") from error

    from m2t_text.util.compiled import Group

    compile_beside(Group)
    source = context.get_parameter_source("index")
    unnamed = source is not None and source.name == "DEFAULT"
    what = Serving(index, unnamed, host, port, name or (), write, saved_map or ())
    run(what, _tell, has_screen() if open_page is None else open_page)


def _tell(address: str) -> None:
    print_lines(f"{address} shows the index; Ctrl-C ends it")
