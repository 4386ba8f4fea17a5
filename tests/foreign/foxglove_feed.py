"""Listener of the Foxglove feed, with robo-ws-bridge.

Messages are decoded with mcap-ros2-support by the definitions of the feed.
"""

import asyncio
import time
from typing import Self

from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory
from robo_ws_bridge import WebSocketBridgeClient


class Feed:
    """A connection that subscribes to every topic."""

    def __init__(self, url: str) -> None:
        """Prepares a connection to the feed at this address."""
        self.client = WebSocketBridgeClient(url, min_retry_delay=0.2, max_retry_delay=0.2)
        self.client.on_advertised_channel(self._subscribe)
        self.client.on_message(self._take)
        self._received: list[tuple[dict, bytes]] = []
        self._last_s = time.monotonic()
        self._last_of: dict[str, float] = {}

    async def __aenter__(self) -> Self:
        """Connects as soon as the feed exists."""
        await self.client.connect()
        return self

    async def __aexit__(self, *_: object) -> None:
        """Closes the connection."""
        await self.client.disconnect()

    async def _subscribe(self, channel: dict) -> None:
        await self.client.subscribe(channel["topic"])

    def _take(self, channel: dict, _time_ns: int, payload: bytes) -> None:
        self._received.append((channel, payload))
        self._last_s = self._last_of[channel["topic"]] = time.monotonic()

    async def silence(self, first_s: float, silence_s: float) -> None:
        """Waits until no message has arrived for `silence_s`; the first message may take `first_s`."""
        while time.monotonic() < self._last_s + (silence_s if self._received else first_s):
            await asyncio.sleep(0.1)

    async def silence_of(self, ending: str, first_s: float, silence_s: float) -> None:
        """Waits as `silence`, for the topics with this ending alone."""
        begun_s = time.monotonic()
        while True:
            last_s = [at_s for topic, at_s in self._last_of.items() if topic.endswith(ending)]
            if time.monotonic() > (max(last_s) + silence_s if last_s else begun_s + first_s):
                return
            await asyncio.sleep(0.1)

    def received(self) -> list[tuple[dict, bytes]]:
        """Channel and content of each received message."""
        return list(self._received)

    def messages(self) -> list[tuple[str, object]]:
        """Topic and content of each received message."""
        return [(channel["topic"], decoded(channel, payload)) for channel, payload in self._received]


_decoders = DecoderFactory()


def decoded(channel: dict, payload: bytes) -> object:
    """Decodes a message of a channel."""
    definition = channel["schema"].encode()
    schema = Schema(id=channel["id"], name=channel["schemaName"], encoding=channel["schemaEncoding"], data=definition)
    return _decoders.decoder_for(channel["encoding"], schema)(payload)
