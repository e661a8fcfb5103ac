"""Gives every other submission a real mask, and every other request a job that is there, so that what
lies behind "no such job" is reached too."""

import os
import random

import schemathesis
from schemathesis import GenerationMode

with open(os.environ["CONTRACT_MASK"], "rb") as file:
    MASK = file.read()
JOBS = []


def is_valid(case):
    return case.meta is None or case.meta.generation.mode == GenerationMode.POSITIVE


def is_stateful(case):
    """There the id is that of a job made before."""
    return case.meta is None or "stateful" in str(case.meta.phase.name).lower()


@schemathesis.hook
def before_call(context, case, kwargs):
    if not is_valid(case) or random.random() < 0.5:
        return
    if case.operation.label == "POST /v1/jobs" and case.media_type != "multipart/form-data":
        case.body = MASK
    elif JOBS and "{id}" in case.operation.path and not is_stateful(case):
        case.path_parameters["id"] = random.choice(JOBS[-20:])


@schemathesis.hook
def after_call(context, case, response):
    if case.method == "POST" and case.operation.path == "/v1/jobs" and response.status_code in (200, 202):
        JOBS.append(response.json()["id"])
    if case.method == "DELETE" and case.path_parameters.get("id") in JOBS:
        JOBS.remove(case.path_parameters["id"])
