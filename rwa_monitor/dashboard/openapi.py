"""The OpenAPI document of the REST interface, with the bus's schemas."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import models_json_schema

from rwa_monitor.history.records import AlarmRecord, EstimateRecord
from rwa_monitor.messages import Changepoints, Diagnosis, SamplesMessage, Status
from rwa_monitor.version import RELEASE


def openapi(acknowledgement: type[BaseModel]) -> dict[str, Any]:
    """Return the OpenAPI 3.1 document."""
    shown = (Diagnosis, Status, Changepoints, SamplesMessage, AlarmRecord, EstimateRecord, acknowledgement)
    _, definitions = models_json_schema(
        [(model, "validation") for model in shown], ref_template="#/components/schemas/{model}"
    )
    wheel = [
        {"name": name, "in": "path", "required": True, "schema": {"type": "string"}} for name in ("spacecraft", "wheel")
    ]
    limit = {"name": "limit", "in": "query", "schema": {"type": "integer", "minimum": 1, "maximum": 1000}}
    entries = {"type": "array", "items": {"type": "object", "required": ["key", "received_wall_ns", "message"]}}
    path = "/api/wheels/{spacecraft}/{wheel}"
    name = {"name": "name", "in": "path", "required": True, "schema": {"type": "string"}}
    alarm = {"name": "alarm", "in": "path", "required": True, "schema": {"type": "integer"}}
    change = _operation("Acknowledge an alarm", _reference(AlarmRecord), [alarm])
    change["requestBody"] = {"required": True, "content": {"application/json": {"schema": _reference(acknowledgement)}}}
    change["security"] = [{"token": []}]
    return {
        "openapi": "3.1.0",
        "info": {"title": "rwa-monitor dashboard", "version": RELEASE},
        "paths": {
            "/api/fleet": {"get": _operation("Latest messages of every wheel", entries)},
            path: {"get": _operation("Samples, thinned, and provisional changepoints", {"type": "object"}, wheel)},
            f"{path}/windows": {"get": _operation("Diagnoses", _list(Diagnosis), [*wheel, limit])},
            f"{path}/estimates": {"get": _operation("Estimates", _list(EstimateRecord), [*wheel, limit])},
            "/api/alarms": {"get": _operation("Open alarms and the latest closed ones", _list(AlarmRecord))},
            "/api/alarms/{alarm}/acknowledge": {"post": change},
            "/api/recordings": {"get": _operation("Recordings", {"type": "array", "items": {"type": "object"}})},
            "/api/recordings/{name}": {"get": _operation("One recording, thinned", {"type": "object"}, [name])},
        },
        "components": {
            "schemas": definitions.get("$defs", {}),
            "securitySchemes": {"token": {"type": "http", "scheme": "bearer"}},
        },
    }


def _reference(model: type[BaseModel]) -> dict[str, Any]:
    return {"$ref": f"#/components/schemas/{model.__name__}"}


def _list(model: type[BaseModel]) -> dict[str, Any]:
    return {"type": "array", "items": _reference(model)}


def _operation(summary: str, schema: dict[str, Any], parameters: list[dict[str, Any]] | None = None) -> dict[str, Any]:
    return {
        "summary": summary,
        "parameters": parameters or [],
        "responses": {"200": {"description": summary, "content": {"application/json": {"schema": schema}}}},
    }
