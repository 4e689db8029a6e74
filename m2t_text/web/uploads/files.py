"""Files that were uploaded: each in a folder that goes with it, read in a process of its own."""

import secrets
import shutil
import tempfile
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from m2t_text.config import Parameters
from m2t_text.description.document import Document
from m2t_text.errors import M2TError, QueryError, SourceError
from m2t_text.util.names import ENDINGS, dataset_name, is_saved_map
from m2t_text.web.naming import UPLOAD
from m2t_text.web.uploads.drives import from_message, image_from_message
from m2t_text.web.uploads.parsing import Job, check_image
from m2t_text.web.uploads.processes import Process, Readers, end, listen
from m2t_text.web.walls import Drawn

AT_ONCE = 2  # files that are received or read
MAX_UPLOADS = 8  # uploads; the oldest goes when one more comes
BYTES = 200 * 10**6  # of a file


WAITING, RECEIVING, READING, READY, FAILED = "waiting", "receiving", "reading", "ready", "failed"


class BusyError(M2TError):
    """Too much is going on at once; the same is possible later."""


@dataclass
class Upload:
    """One file that was uploaded, and what it shows.

    Attributes:
        id: random, so that nobody guesses it.
        folder: holds the file, and goes with the upload.
        state: RECEIVING the file; WAITING for the image of a saved map; READING; READY; or FAILED.
        progress: stage, done, total.
        documents: described so far, in their order.
        image: what a saved map shows by itself.
        added: what became of adding it to an index: None, "adding", "added", or one line that says what failed.
    """

    id: str
    file: str
    name: str
    folder: Path
    state: str = RECEIVING
    progress: tuple[str, int, int] = ("receiving", 0, 0)
    documents: list[Document] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    error: str | None = None
    needs: str | None = None
    image: Drawn | None = None
    added: str | None = None
    changed: threading.Condition = field(default_factory=threading.Condition)
    process: Process | None = None

    @property
    def path(self) -> Path:
        return self.folder / self.file

    @property
    def done(self) -> bool:
        """Whether no more maps will come."""
        return self.state in (READY, FAILED)

    def set(self, **values: Any) -> None:
        """Changes attributes, and wakes those that wait for a change."""
        with self.changed:
            for name, value in values.items():
                setattr(self, name, value)
            self.changed.notify_all()

    def take(self, document: Document) -> None:
        with self.changed:
            self.documents.append(document)
            self.changed.notify_all()

    def wait(self, count: int, seconds: float) -> bool:
        """Waits until there are more than ``count`` documents or no more will come; whether there are."""
        with self.changed:
            self.changed.wait_for(lambda: len(self.documents) > count or self.done, seconds)
            return len(self.documents) > count

    def to_json(self) -> dict[str, Any]:
        with self.changed:
            return {
                "id": self.id,
                "file": self.file,
                "dataset": self.name,
                "state": self.state,
                "progress": {"stage": self.progress[0], "done": self.progress[1], "total": self.progress[2]},
                "maps": len(self.documents),
                "driven": bool(self.documents and self.documents[0].driven),
                "warnings": self.warnings,
                "error": self.error,
                "needs": self.needs,
                "added": self.added,
            }


Take = Callable[[Upload, dict[str, Any]], None]


class Uploads:
    """All uploads of a server. Close it, and nothing is left of them."""

    def __init__(self) -> None:
        self._folder = Path(tempfile.mkdtemp(prefix="m2t-text-uploads-"))
        self._uploads: dict[str, Upload] = {}
        self._lock = threading.Lock()
        self._readers = Readers()

    def warm(self) -> None:
        """Has a process ready for the first upload."""
        self._readers.warm()

    def close(self) -> None:
        for upload in list(self._uploads.values()):
            self.remove(upload.id)
        self._readers.close()
        shutil.rmtree(self._folder, ignore_errors=True)

    def all(self) -> list[Upload]:
        return list(self._uploads.values())

    def get(self, upload: str) -> Upload:
        """Raises QueryError if there is none of this id."""
        found = self._uploads.get(upload)
        if found is None:
            raise QueryError(f"no upload {upload[:40]!r}; it was removed, or the server began anew")
        return found

    def document(self, upload: str, first_scan: int) -> Document:
        """An uploaded map. Raises QueryError if there is none."""
        for document in self.get(upload).documents:
            if document.first_scan == first_scan:
                return document
        raise QueryError(f"no map '{UPLOAD}{upload}/{first_scan:06d}' was uploaded")

    def begin(self, file: str) -> Upload:
        """A place for a file of this name.

        Raises:
            SourceError: if nothing that can be read is named so, or the name could lead elsewhere.
            BusyError: if AT_ONCE others are being received or read.
        """
        if "/" in file or "\\" in file or file.startswith(".") or not file.isprintable() or len(file) > 200:
            raise SourceError(f"{file[:60]!r} cannot name a file; send its plain name, as drive.log")
        if not file.lower().endswith(ENDINGS):
            raise SourceError(f"{file!r} is of no kind that can be read; send one of {', '.join(ENDINGS)}")
        name = dataset_name(file)
        with self._lock:
            if sum(not one.done and one.state != WAITING for one in self.all()) >= AT_ONCE:
                raise BusyError(f"{AT_ONCE} other uploads are being read; send it again when they are done")
            self._forget()
            upload = Upload(secrets.token_hex(8), file, name, Path(tempfile.mkdtemp(dir=self._folder)))
            self._uploads[upload.id] = upload
        return upload

    def _forget(self) -> None:
        """Removes the oldest that are done, so that there is room for one more."""
        settled = [one for one in self.all() if one.done or one.state == WAITING]
        for upload in settled[: max(0, len(self._uploads) - MAX_UPLOADS + 1)]:
            self._remove(upload)

    def remove(self, upload: str) -> None:
        with self._lock:
            self._remove(self.get(upload))

    def _remove(self, upload: Upload) -> None:
        self._uploads.pop(upload.id, None)
        end(upload.process)
        upload.set(state=FAILED, error=upload.error or "it was removed")
        shutil.rmtree(upload.folder, ignore_errors=True)

    def received(self, upload: Upload, parameters: Parameters) -> None:
        """To be called when a file is there: reads it, if nothing that belongs to it is missing.

        Raises MapFileError if it is a saved map that names what cannot be sent.
        """
        if is_saved_map(upload.path):
            image = check_image(upload.path)
            if not image.exists():
                upload.set(state=WAITING, needs=image.name)
                return
        upload.set(state=READING, needs=None, progress=("reading", 0, 0))
        self._start(upload, Job(upload.path, upload.name, parameters), self._take)

    def add(self, upload: Upload, parameters: Parameters, index: Path) -> None:
        """Puts the dataset of an upload that is READY into an index; `Upload.added` says what became of it."""
        if upload.state != READY:
            raise QueryError(f"{upload.file!r} is not read yet")
        with self._lock:
            if upload.added == "adding":
                raise BusyError(f"{upload.file!r} is being added")
            upload.set(added="adding")
        job = Job(upload.path, upload.name, parameters, index.absolute())
        self._start(upload, job, self._note_added)

    def _start(self, upload: Upload, job: Job, take: Take) -> None:
        process = upload.process = self._readers.take()
        assert process.stdin is not None
        process.stdin.write(f"{job.to_json()}\n")
        process.stdin.flush()
        threading.Thread(target=listen, args=(process, partial(take, upload)), daemon=True).start()

    def _take(self, upload: Upload, message: dict[str, Any]) -> None:
        if "map" in message:
            upload.take(from_message(message["map"]))
        elif "image" in message:
            upload.set(image=image_from_message(message["image"]))
        elif "progress" in message:
            upload.set(progress=tuple(message["progress"]))
        elif "warnings" in message:
            upload.set(warnings=message["warnings"])
        elif "error" in message:
            upload.set(state=FAILED, error=message["error"])
        else:
            upload.set(state=READY)

    def _note_added(self, upload: Upload, message: dict[str, Any]) -> None:
        if "progress" in message:
            upload.set(progress=tuple(message["progress"]))
        else:
            upload.set(added=message.get("error", "added"))
