"""Requests that read an index: maps, searches, comparisons, and what the page draws."""

import json
from collections.abc import Callable
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from m2t_text import __version__
from m2t_text.errors import QueryError
from m2t_text.web.asking import MAX_LISTED, Search, whole, words
from m2t_text.web.routes import answers
from m2t_text.web.routes.openapi import document as openapi
from m2t_text.web.served import Committed, NoIndexError
from m2t_text.web.site import Site

ASSETS = Path(str(files("m2t_text.web") / "assets"))
JSON_BYTES = 4 << 20  # of a search that is posted


class Reading:
    """One method a route."""

    def __init__(self, site: Site) -> None:
        self._site = site

    async def page(self, request: Request) -> Response:
        return Response((ASSETS / "index.html").read_bytes(), media_type="text/html; charset=utf-8")

    async def openapi(self, request: Request) -> Response:
        return JSONResponse(openapi(__version__))

    async def info(self, request: Request) -> Response:
        """The document of ``info --json``, and what the page needs to know of the server."""
        name = request.query_params.get("index")
        server = {"version": __version__, "writable": self._site.writable}
        try:
            committed = await self._site.committed(request)
        except NoIndexError as error:
            path = self._site.library.folder(name)
            return JSONResponse(
                {"path": str(path), "maps": 0, "datasets": [], "error": str(error), "server": server}
            )
        if _is_current(request, committed):
            return Response(status_code=304, headers=_tag(committed))
        others = [path.name for path in await self._site.read(lambda: self._site.library.others)]
        document = await self._site.read(committed.info.to_json)
        more = {"revision": committed.revision, "indexes": [self._site.library.path.name, *others]}
        return JSONResponse(document | more | {"server": server}, headers=_tag(committed))

    async def places(self, request: Request) -> Response:
        return await self._binary(request, lambda committed: committed.places)

    async def walls(self, request: Request) -> Response:
        name = request.query_params.get("dataset", "")
        return await self._binary(request, lambda committed: committed.walls(name))

    async def _binary(self, request: Request, make: Callable[[Committed], bytes]) -> Response:
        committed = await self._site.committed(request)
        if _is_current(request, committed):
            return Response(status_code=304, headers=_tag(committed))
        data = await self._site.read(partial(make, committed))
        return Response(data, media_type="application/octet-stream", headers=_tag(committed))

    async def matching(self, request: Request) -> Response:
        """The numbers, in the order of `places`, of the maps that a query of Whoosh's language finds."""
        where = request.query_params.get("where") or ""
        committed = await self._site.committed(request)
        found = await self._site.search(lambda: committed.index.matching(where))
        return JSONResponse({"total": int(found.sum()), "places": found.nonzero()[0].tolist()})

    async def maps(self, request: Request) -> Response:
        values = request.query_params
        where, dataset = words(values, "where"), words(values, "dataset")
        offset, limit = whole(values, "offset", 0, 1 << 40), whole(values, "limit", 100, MAX_LISTED)
        committed = await self._site.committed(request)
        return JSONResponse(
            await self._site.search(lambda: answers.listed(committed, where, dataset, offset, limit))
        )

    async def map(self, request: Request) -> Response:
        """The document of ``inspect --json``, and where the map lies."""
        committed = await self._site.committed(request)
        name = request.path_params["name"]
        return JSONResponse(await self._site.read(lambda: answers.map(committed, self._site, name)))

    async def search(self, request: Request) -> Response:
        """The document of ``search --json``, and if asked for how the query lies on the best hits."""
        values = dict(request.query_params) if request.method == "GET" else await _posted(request)
        asked = Search.read(values)
        committed = await self._site.read(lambda: self._site.library.latest(asked.index))
        return JSONResponse(await self._site.search(lambda: answers.answered(committed, self._site, asked)))

    async def compare(self, request: Request) -> Response:
        committed = await self._site.committed(request)
        a, b = request.query_params.get("a", ""), request.query_params.get("b", "")
        return JSONResponse(await self._site.search(lambda: answers.compared(committed, self._site, a, b)))


def _tag(committed: Committed) -> dict[str, str]:
    return {"ETag": f'"{committed.revision}"'}


def _is_current(request: Request, committed: Committed) -> bool:
    return request.headers.get("if-none-match") == _tag(committed)["ETag"]


async def _posted(request: Request) -> dict[str, Any]:
    if request.headers.get("content-type", "").partition(";")[0].strip() != "application/json":
        raise HTTPException(415, "post a search as application/json")
    body = b""
    async for chunk in request.stream():
        body += chunk
        if len(body) > JSON_BYTES:
            raise HTTPException(413, f"a search takes up to {JSON_BYTES >> 20} MB")
    try:
        values = json.loads(body)
    except (ValueError, RecursionError) as error:
        raise QueryError("the search is not JSON") from error
    if not isinstance(values, dict):
        raise QueryError("the search is not a JSON object")
    return values
