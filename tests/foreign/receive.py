"""Receives magnetic fields with rosless: topic and number to expect; prints how many came, whether in order, and in how many seconds."""

import sys
import time

import rosless

topic, expected = sys.argv[1], int(sys.argv[2])
received = []
with rosless.subscribe(topic, wait=30.0, type_name="sensor_msgs/msg/MagneticField", reliability="reliable", history="keep_all") as subscription:
    silence_s = 40.0
    while len(received) < expected:
        message = subscription.read(timeout=silence_s)
        if message is None:
            break
        received.append((message.magnetic_field.x, time.time()))
        silence_s = 5.0
values = [value for value, _ in received]
in_order = values == [float(i) for i in range(len(values))]
print(len(received), in_order, received[-1][1] - received[0][1] if received else 0.0)
