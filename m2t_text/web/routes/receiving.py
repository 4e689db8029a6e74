"""Requests about what is uploaded: receiving it, what it shows, looking it up as it went, and adding it."""

import json
from asyncio import Task, create_task
from collections import deque
from collections.abc import AsyncIterator
from functools import partial
from pathlib import Path
from typing import Any

import anyio
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, Response, StreamingResponse

from m2t_text.config import Parameters
from m2t_text.description.document import Document
from m2t_text.errors import QueryError
from m2t_text.util.workers import cores
from m2t_text.web.asking import whole
from m2t_text.web.routes.replay import PROGRESS_INTERVAL, Drive, IndexedDrive, UploadedDrive, looked_up
from m2t_text.web.served import Committed
from m2t_text.web.site import Site
from m2t_text.web.uploads.files import BYTES, Upload
from m2t_text.web.walls import walls_and_places

AHEAD = 2  # places for each core that are looked up or wait for it


class Receiving:
    """One method a route."""

    def __init__(self, site: Site) -> None:
        self._site = site

    async def uploads(self, request: Request) -> Response:
        return JSONResponse({"uploads": [one.to_json() for one in self._site.uploads.all()]})

    async def upload(self, request: Request) -> Response:
        """Receives a file, whose name is in the address and whose bytes are the body."""
        _check_plain(request)
        _check_size(request)
        parameters = await self._site.read(lambda: self._site.parameters(request.query_params.get("index")))
        upload = self._site.uploads.begin(request.query_params.get("name", ""))
        await self._receive(request, upload, upload.path, parameters)
        return JSONResponse(upload.to_json(), 201, {"Location": f"/api/uploads/{upload.id}"})

    async def image(self, request: Request) -> Response:
        """Receives the image of a saved map, which waits for it."""
        _check_plain(request)
        _check_size(request)
        upload = self._site.uploads.get(request.path_params["id"])
        if upload.needs is None or request.path_params["file"] != upload.needs:
            raise QueryError(f"{upload.file!r} needs {upload.needs or 'no other file'}")
        parameters = await self._site.read(lambda: self._site.parameters(request.query_params.get("index")))
        await self._receive(request, upload, upload.folder / upload.needs, parameters)
        return JSONResponse(upload.to_json(), 201)

    async def _receive(self, request: Request, upload: Upload, path: Path, parameters: Parameters) -> None:
        """Writes what is sent to a file, and has it read. Nothing is left of it if it does not arrive whole."""
        complete = False
        try:
            await _received(request, path)
            await self._site.read(lambda: self._site.uploads.received(upload, parameters))
            complete = True
        finally:
            if not complete:
                self._site.uploads.remove(upload.id)

    async def one_upload(self, request: Request) -> Response:
        return JSONResponse(self._site.uploads.get(request.path_params["id"]).to_json())

    async def remove_upload(self, request: Request) -> Response:
        await self._site.read(lambda: self._site.uploads.remove(request.path_params["id"]))
        return Response(status_code=204)

    async def upload_places(self, request: Request) -> Response:
        """What the maps of an upload saw, as `walls` gives it, and where they begin."""
        upload = self._site.uploads.get(request.path_params["id"])
        parameters = await self._site.read(lambda: self._site.parameters(request.query_params.get("index")))
        data = await self._site.read(
            lambda: walls_and_places(list(upload.documents), parameters.mapping.cell, upload.image)
        )
        return Response(data, media_type="application/octet-stream")

    async def add_upload(self, request: Request) -> Response:
        _check_plain(request)
        if not self._site.writable:
            raise HTTPException(403, "this server only reads; start it with --write")
        name = request.query_params.get("index")
        upload = self._site.uploads.get(request.path_params["id"])
        parameters = await self._site.read(lambda: self._site.parameters(name))
        self._site.uploads.add(upload, parameters, self._site.library.folder(name))
        return JSONResponse(upload.to_json(), 202)

    async def replay(self, request: Request) -> Response:
        """The places of a drive looked up one by one, as server-sent events."""
        committed = await self._site.committed(request)
        name = request.path_params["id"]
        asked = dict(request.query_params)
        begin = whole({"from": request.headers.get("last-event-id", asked.get("from", 0))}, "from", 0, 1 << 40)
        upload = name if name in {one.id for one in self._site.uploads.all()} else None
        drive: Drive = (
            UploadedDrive(self._site.uploads.get(upload))
            if upload
            else await self._site.read(lambda: IndexedDrive(name, committed))
        )
        events = self._events(drive, committed, begin, upload)
        return StreamingResponse(events, media_type="text/event-stream", headers={"X-Accel-Buffering": "no"})

    async def _events(
        self, drive: Drive, committed: Committed, begin: int, upload: str | None
    ) -> AsyncIterator[str]:
        yield _event("begin", drive.progress() | {"total": drive.total})
        number = begin
        coming: deque[Task[dict[str, Any]]] = deque()  # places that are looked up, from ``number`` on
        try:
            while coming or drive.total is None or number < drive.total:
                for document in await self._site.read(partial(self._next, drive, number, len(coming))):
                    found = partial(looked_up, number + len(coming), document, committed, upload)
                    coming.append(create_task(self._site.search(found)))
                if coming:
                    place = await coming.popleft()
                    number += 1
                    yield _event("place", place, number)
                else:
                    yield _event("progress", drive.progress())
            yield _event("end", drive.progress() | {"total": drive.total})
        finally:
            for task in coming:
                task.cancel()

    @staticmethod
    def _next(drive: Drive, number: int, coming: int) -> list[Document]:
        """The places of a drive to look up next, beside those that are ``coming``; waits if there are none."""
        return drive.places(number + coming, AHEAD * cores(None) - coming, 0.0 if coming else PROGRESS_INTERVAL)


def _event(kind: str, data: dict[str, Any], number: int | None = None) -> str:
    identity = "" if number is None else f"id: {number}\n"
    return f"event: {kind}\n{identity}data: {json.dumps(data, allow_nan=False)}\n\n"


def _check_plain(request: Request) -> None:
    """That a browser asked before it sent this from another page: forms cannot send this type."""
    if request.headers.get("content-type", "").partition(";")[0].strip() not in ("application/octet-stream",):
        raise HTTPException(415, "send the bytes as application/octet-stream")


def _check_size(request: Request) -> None:
    length = request.headers.get("content-length", "0")
    if not length.isdecimal() or int(length) > BYTES:
        raise _too_large()


def _too_large() -> HTTPException:
    most = BYTES // 10**6
    return HTTPException(413, f"files of up to {most} MB are taken; index larger ones with m2t-text index")


async def _received(request: Request, path: Path) -> None:
    received = 0
    async with await anyio.open_file(path, "xb") as file:
        async for chunk in request.stream():
            received += len(chunk)
            if received > BYTES:
                raise _too_large()
            await file.write(chunk)
