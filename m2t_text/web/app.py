"""The HTTP interface as one application: routes, what becomes of errors, and the guard before all of it."""

import logging
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import anyio
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp

from m2t_text.errors import M2TError, MapIndexError, QueryError
from m2t_text.web.routes import replay
from m2t_text.web.routes.reading import ASSETS, Reading
from m2t_text.web.routes.receiving import Receiving
from m2t_text.web.security import Access, Guard
from m2t_text.web.served import NoIndexError
from m2t_text.web.site import Site
from m2t_text.web.uploads.files import BusyError

log = logging.getLogger("m2t_text.web")


def create_app(site: Site, access: Access) -> ASGIApp:
    """The whole interface, guarded."""

    @asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        async with anyio.create_task_group() as group:
            group.start_soon(_warm, site)
            yield
            group.cancel_scope.cancel()
        site.uploads.close()

    handlers, receiving = Reading(site), Receiving(site)
    routes = [
        Route("/", handlers.page),
        Route("/api/info", handlers.info),
        Route("/api/openapi.json", handlers.openapi),
        Route("/api/places", handlers.places),
        Route("/api/walls", handlers.walls),
        Route("/api/matching", handlers.matching),
        Route("/api/maps", handlers.maps),
        Route("/api/maps/{name:path}", handlers.map),
        Route("/api/search", handlers.search, methods=["GET", "POST"]),
        Route("/api/compare", handlers.compare),
        Route("/api/uploads", receiving.uploads, methods=["GET"]),
        Route("/api/uploads", receiving.upload, methods=["POST"]),
        Route("/api/uploads/{id}", receiving.one_upload, methods=["GET"]),
        Route("/api/uploads/{id}", receiving.remove_upload, methods=["DELETE"]),
        Route("/api/uploads/{id}/places", receiving.upload_places),
        Route("/api/uploads/{id}/index", receiving.add_upload, methods=["POST"]),
        Route("/api/uploads/{id}/{file}", receiving.image, methods=["PUT"]),
        Route("/api/replay/{id:path}", receiving.replay),
        Mount("/assets", StaticFiles(directory=ASSETS)),
    ]
    errors = {M2TError: _known_problem, HTTPException: _http_problem, Exception: _unknown_problem}
    return Guard(Starlette(routes=routes, exception_handlers=errors, lifespan=lifespan), access)


async def _warm(site: Site) -> None:
    """Loads what the first search and the first upload need, before they are asked for."""

    def search() -> None:
        committed = site.library.latest()
        if len(committed.overview):
            document = next(committed.index.numbered(committed.overview.numbers[:1].tolist()))
            replay.looked_up(0, document, committed, None)

    try:
        await site.search(search)
    except M2TError as error:
        log.info("nothing to warm up with: %s", error)
    await site.read(site.uploads.warm)


def _known_problem(request: Request, error: Exception) -> Response:
    status = 400
    if isinstance(error, BusyError):
        return _problem(str(error), 429, {"Retry-After": "5"})
    if isinstance(error, QueryError) and str(error).startswith("no "):
        status = 404
    if isinstance(error, MapIndexError):
        status = 404 if isinstance(error, NoIndexError) else 503
    return _problem(str(error), status)


def _http_problem(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    return _problem(error.detail, error.status_code)


def _unknown_problem(request: Request, error: Exception) -> Response:
    log.error("%s %s failed", request.method, request.url.path, exc_info=error)
    return _problem("something went wrong in the server; its terminal says more", 500)


def _problem(reason: str, status: int, headers: dict[str, str] | None = None) -> Response:
    return JSONResponse({"error": reason}, status, headers)
