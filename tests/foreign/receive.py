"""Receives magnetic fields with rosless: prints number, order and duration of the received messages.

The arguments are topic and expected number.
"""

import sys
import time

import rosless

TYPE = "sensor_msgs/msg/MagneticField"

topic, expected = sys.argv[1], int(sys.argv[2])
received = []
with rosless.subscribe(topic, type_name=TYPE, wait=30.0, reliability="reliable", history="keep_all") as fields:
    silence_s = 40.0
    while len(received) < expected:
        message = fields.read(timeout=silence_s)
        if message is None:
            break
        received.append((message.magnetic_field.x, time.time()))
        silence_s = 5.0
values = [value for value, _ in received]
in_order = values == [float(i) for i in range(len(values))]
print(len(received), in_order, received[-1][1] - received[0][1] if received else 0.0)
