"""The AsyncAPI document: each reference leads somewhere, and it has every message and query."""

import re

import pytest
from gaitd_client import wire
from gaitd_client.wire.asyncapi import ACTING, PUBLISHED, asyncapi

from daemon.gateway.requests import ROUTES

DOCUMENT = asyncapi()


def references(part):
    if isinstance(part, dict):
        if isinstance(part.get("$ref"), str):
            yield part["$ref"]
        for one in part.values():
            yield from references(one)
    elif isinstance(part, list | tuple):
        for one in part:
            yield from references(one)


def found(reference):
    at = DOCUMENT
    for name in reference.removeprefix("#/").split("/"):
        at = at[name]
    return at


def test_each_reference_leads_somewhere():
    every = set(references(DOCUMENT))
    assert len(every) > 100
    for reference in every:
        assert found(reference)


def test_it_has_every_message_and_every_query():
    of_channels = {name for one in DOCUMENT["channels"].values() for name in one["messages"]}
    assert of_channels == {*wire.MESSAGES, "frame", "received"}
    assert {*ACTING, *wire.READING} == set(ROUTES)
    assert {f"send_{name}" for name in PUBLISHED} < set(DOCUMENT["operations"])


@pytest.mark.parametrize("name", DOCUMENT["channels"])
def test_the_parameters_of_a_channel_are_those_of_its_address(name):
    channel = DOCUMENT["channels"][name]
    assert set(re.findall(r"\{(\w+)\}", channel["address"])) == set(channel.get("parameters", ()))
    assert channel["servers"]
