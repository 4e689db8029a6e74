"""What is served: the indexes, the uploads, and how many requests are worked on at once."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeVar

import anyio
from anyio import to_thread
from starlette.requests import Request

from m2t_text.config import PROFILES, Parameters
from m2t_text.util.workers import cores
from m2t_text.web.served import Committed, Library, NoIndexError
from m2t_text.web.uploads.files import Uploads

Result = TypeVar("Result")


@dataclass
class Site:
    """What is served.

    Attributes:
        library: the indexes.
        writable: whether uploads may be added to the index.
        searching: so many searches go on at once; others wait their turn.
    """

    library: Library
    writable: bool = False
    uploads: Uploads = field(default_factory=Uploads)
    searching: anyio.CapacityLimiter = field(default_factory=lambda: anyio.CapacityLimiter(cores(None)))
    reading: anyio.CapacityLimiter = field(default_factory=lambda: anyio.CapacityLimiter(4))

    async def search(self, function: Callable[[], Result]) -> Result:
        """What a function gives that searches. A server that ends does not wait for it."""
        return await to_thread.run_sync(function, limiter=self.searching, abandon_on_cancel=True)

    async def read(self, function: Callable[[], Result]) -> Result:
        """What a function gives that reads."""
        return await to_thread.run_sync(function, limiter=self.reading)

    def parameters(self, index: str | None) -> Parameters:
        """How an upload is described: as the index, if there is one."""
        try:
            return self.library.latest(index).index.parameters
        except NoIndexError:
            return PROFILES["default"]

    async def committed(self, request: Request) -> Committed:
        """The latest state of the index that a request names."""
        name = request.query_params.get("index")
        return await self.read(lambda: self.library.latest(name))
