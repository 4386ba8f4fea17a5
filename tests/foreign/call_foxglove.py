"""Calls the service of the Foxglove feed; prints the positions of the pushes (m).

The arguments are the address of the feed, its token and those of the call.
"""

import asyncio
import sys

from foxglove_feed import Feed
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

REQUEST = "whisker_interfaces/msg/Request"

url, token, (x, y, increments_x, increments_y, pause) = sys.argv[1], sys.argv[2], sys.argv[3:]


def request(definition: str) -> bytes:
    """The serialised request, by the definition of the feed."""
    types = get_typestore(Stores.ROS2_HUMBLE)
    types.register(get_types_from_msg(definition, REQUEST))
    arguments = (float(x), float(y), int(increments_x), int(increments_y), int(pause), token)
    return bytes(types.serialize_cdr(types.types[REQUEST](*arguments), REQUEST))


async def main() -> None:
    """Waits for the service, calls it and listens."""
    async with Feed(url) as feed, asyncio.timeout(300):
        while not feed.client.services:
            await asyncio.sleep(0.1)
        [service] = [service for service in feed.client.services.values() if service["name"] == "/increments_beam_test"]
        await asyncio.sleep(1.0)
        call = request(service["request"]["schema"])
        answer = await feed.client.call_service(service["id"], call, encoding="cdr", timeout=240.0)
        assert answer.payload == b"\x00\x01\x00\x00\x00", answer
        await asyncio.sleep(1.0)
        for topic, message in feed.messages():
            if topic == "/truth/pushed":
                print(f"{message.pose.position.y:.4f}")


asyncio.run(main())
