"""What can be asked, as an OpenAPI 3.1 document."""

from typing import Any

Schema = dict[str, Any]

STRING, NUMBER, WHOLE, TRUTH = ({"type": kind} for kind in ("string", "number", "integer", "boolean"))
POSE = {"type": "array", "items": NUMBER, "minItems": 3, "maxItems": 3, "description": "x, y (m), theta (rad)"}
TRAVEL = {"type": "array", "items": NUMBER, "minItems": 2, "maxItems": 2, "description": "metres: from, to"}
BINARY = {
    "description": "uint32 length of a JSON header, the header, then the columns that it lists (little-endian, "
    "each filled up to a multiple of 8 bytes)",
    "content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}},
}


def document(version: str) -> Schema:
    """The whole document."""
    return {
        "openapi": "3.1.0",
        "info": {
            "title": "m2t-text",
            "version": version,
            "description": "Places found again by the texts of local maps. Lengths are metres, angles radians. "
            "Where the command line has a command, the JSON is that of its --json.",
        },
        "paths": _paths(),
        "components": {
            "schemas": _schemas(),
            "securitySchemes": {"token": {"type": "http", "scheme": "bearer"}},
        },
        "security": [{}, {"token": []}],
    }


def _paths() -> Schema:
    index = _asked("index", STRING, "name of another index of the folder")
    where = _asked("where", STRING, "only maps that this query finds: tokens, dataset:NAME, travel:[10 TO 40]")
    ident = _part("id", STRING, "of an upload")
    search = [
        _asked("query", STRING, "a map id, DATASET@METRES, DATASET#SCAN, or a text of tokens", True),
        _asked("top", WHOLE | {"default": 10, "minimum": 0}, "hits; 0 for all maps"),
        _asked("exclude_travel", NUMBER, "leave out maps of the same drive within these metres of travel"),
        _asked("verify", TRUTH | {"default": True}, "align the best hits, and judge them"),
        where,
        _asked("compare", WHOLE | {"default": 0, "maximum": 10}, "lay the query on so many of the best hits"),
        index,
    ]
    body = {one["name"]: one["schema"] | {"description": one["description"]} for one in search}
    posted = {
        "required": True,
        "content": _json({"type": "object", "properties": body | {"text": STRING | {"description": "a text"}}}),
    }
    sent = {"required": True, "content": BINARY["content"]}
    name = _asked("name", STRING, "the file's name, whose ending says what it is", True)
    upload = _answer("Upload")
    return {
        "/api/info": {"get": _request("What the index holds, as info --json", [index], _answer("Info"))},
        "/api/maps": {
            "get": _request(
                "Maps, by dataset and first scan",
                [
                    where,
                    _asked("dataset", STRING, "only of this dataset"),
                    _asked("offset", WHOLE | {"default": 0}, "how many to skip"),
                    _asked("limit", WHOLE | {"default": 100, "maximum": 10000}, "how many to list"),
                    index,
                ],
                _answer("MapList"),
            )
        },
        "/api/maps/{id}": {
            "get": _request(
                "A map and its text, as inspect --json",
                [_part("id", STRING, "a map id"), index],
                _answer("Map"),
            )
        },
        "/api/search": {
            "get": _request("Look a place up, as search --json", search, _answer("Answer")),
            "post": _request("The same for a long text", [], _answer("Answer"), posted),
        },
        "/api/matching": {
            "get": _request("Which places a query finds, as numbers", [where, index], _answer("Matching"))
        },
        "/api/compare": {
            "get": _request(
                "One map laid on another, keypoint by keypoint",
                [_asked("a", STRING, "a map id or text", True), _asked("b", STRING, "another", True), index],
                _answer("Comparison"),
            )
        },
        "/api/places": {"get": _request("Where all maps begin, as columns", [index], BINARY)},
        "/api/walls": {
            "get": _request(
                "Walls and floor of a dataset, as columns",
                [_asked("dataset", STRING, "which", True), index],
                BINARY,
            )
        },
        "/api/uploads": {
            "get": _request("All uploads", [], _ok({"type": "object"})),
            "post": _request("Send a log, bag, saved map or point cloud", [name, index], upload, sent, "201"),
        },
        "/api/uploads/{id}": {
            "get": _request("How far an upload was read", [ident], upload),
            "delete": _request("Remove an upload and its file", [ident], {"description": "gone"}, None, "204"),
        },
        "/api/uploads/{id}/{file}": {
            "put": _request(
                "Send the image of a saved map, which waits for it",
                [ident, _part("file", STRING, "the image's name")],
                upload,
                sent,
                "201",
            )
        },
        "/api/uploads/{id}/places": {"get": _request("What an upload saw, as columns", [ident, index], BINARY)},
        "/api/uploads/{id}/index": {
            "post": _request(
                "Add it to the index, if the server may write", [ident, index], upload, None, "202"
            )
        },
        "/api/replay/{id}": {
            "get": _request(
                "The places of an upload or a dataset, looked up one by one",
                [_part("id", STRING, "of an upload, or the name of a dataset"), index],
                {
                    "description": "events begin, progress, place (number, query, own_pose, answer, …), end",
                    "content": {"text/event-stream": {"schema": STRING}},
                },
            )
        },
    }


def _schemas() -> Schema:
    whole_or_none, pose_or_none = {"type": ["integer", "null"]}, POSE | {"type": ["array", "null"]}
    share = {"type": ["number", "null"], "minimum": 0, "maximum": 1}
    name = {"type": ["string", "null"]}
    hit = {
        "rank": WHOLE,
        "map_id": STRING,
        "dataset": STRING,
        "first_scan": WHOLE,
        "last_scan": WHOLE,
        "travel": TRAVEL,
        "score": NUMBER,
        "matched": WHOLE,
        "pose": pose_or_none | {"description": "of the query's first scan in the frame of the hit's"},
        "dataset_pose": pose_or_none | {"description": "of the query in the frame of the hit's dataset"},
        "covariance": {"type": ["array", "null"], "description": "3 × 3, of dataset_pose"},
        "inlier_ratio": share,
        "conflict_ratio": share,
    }
    text = {
        "map_id": name,
        "text": STRING,
        "keypoints": WHOLE,
        "words": WHOLE,
        "viewpoint": POSE,
        "points": WHOLE,
    }
    place = {
        "dataset": name,
        "first_scan": whole_or_none,
        "last_scan": whole_or_none,
        "dataset_pose": pose_or_none,
    }
    digits = STRING | {"description": "a digit a keypoint: 0 alone, 1 fits, 2 the same word, 3 conflicts"}
    return {
        "Error": _object({"error": STRING}),
        "Info": _object(
            {
                "path": STRING,
                "profile": STRING,
                "parameters": {"type": "object"},
                "maps": WHOLE,
                "keypoints": WHOLE,
                "bytes": WHOLE,
                "datasets": _list(_object({"name": STRING, "maps": WHOLE, "scans": WHOLE, "travel": NUMBER})),
            }
        ),
        "MapList": _object({"total": WHOLE, "offset": WHOLE, "maps": _list({"type": "object"})}),
        "Map": _object(text | {"travel": TRAVEL | {"type": ["array", "null"]}} | place),
        "Answer": _object(
            {
                "query": _object({"map_id": name, "dataset": name, "keypoints": WHOLE}),
                "index": _object({"path": STRING, "maps": WHOLE, "profile": STRING}),
                "seconds": _object({"describe": NUMBER, "search": NUMBER, "verify": NUMBER}),
                "verdict": {"enum": ["match", "ambiguous", "none"]},
                "probability": share,
                "reason": _object({"code": STRING, "text": STRING, "rival": name}),
                "results": _list(_object(hit)),
                "comparisons": _list({"$ref": "#/components/schemas/Comparison"}),
            }
        ),
        "Matching": _object({"total": WHOLE, "places": _list(WHOLE)}),
        "Comparison": _object(
            {
                "laid": POSE
                | {"description": "of the first map's frame in the second's, both at their viewpoints"},
                "inlier_ratio": share,
                "agreement": share,
                "grip": NUMBER,
                "conflict_ratio": share,
                "shared": WHOLE,
                "query_keypoints": digits,
                "found_keypoints": digits,
            }
        ),
        "Upload": _object(
            {
                "id": STRING,
                "file": STRING,
                "dataset": STRING,
                "state": {"enum": ["waiting", "receiving", "reading", "ready", "failed"]},
                "progress": _object({"stage": STRING, "done": WHOLE, "total": WHOLE}),
                "maps": WHOLE,
                "warnings": _list(STRING),
                "error": name,
                "needs": name | {"description": "the image that a saved map waits for"},
                "added": name,
            }
        ),
    }


def _object(properties: Schema) -> Schema:
    return {"type": "object", "properties": properties}


def _list(items: Schema) -> Schema:
    return {"type": "array", "items": items}


def _json(schema: Schema) -> Schema:
    return {"application/json": {"schema": schema}}


def _ok(schema: Schema) -> Schema:
    return {"description": "the answer", "content": _json(schema)}


def _answer(name: str) -> Schema:
    return _ok({"$ref": f"#/components/schemas/{name}"})


def _asked(name: str, schema: Schema, description: str, required: bool = False) -> Schema:
    return {"name": name, "in": "query", "schema": schema, "description": description, "required": required}


def _part(name: str, schema: Schema, description: str) -> Schema:
    return {"name": name, "in": "path", "schema": schema, "description": description, "required": True}


def _request(
    summary: str, parameters: list[Schema], answer: Schema, body: Schema | None = None, status: str = "200"
) -> Schema:
    wrong = {"description": "one line that says what is wrong", "content": _answer("Error")["content"]}
    request: Schema = {"summary": summary, "responses": {status: answer, "default": wrong}}
    if parameters:
        request["parameters"] = parameters
    if body is not None:
        request["requestBody"] = body
    return request
