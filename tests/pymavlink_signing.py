"""A ground station on a signed link: what it believes, and whether it is believed.

Argument 1 is where the daemon listens, as pymavlink writes it, argument 2 the passphrase of both ends. Prints whether
the vehicle's frames and those of component 191 were believed, and whether a parameter was set.
"""

import hashlib
import os
import sys
import time

os.environ["MAVLINK20"] = "1"
from pymavlink import mavutil

link = mavutil.mavlink_connection(sys.argv[1], source_system=255, source_component=190, dialect="ardupilotmega")
link.setup_signing(hashlib.sha256(sys.argv[2].encode()).digest(), sign_outgoing=True, link_id=7)
SYSTEM, US = 1, 191

forwarded = ours = answered = False
until, asked = time.time() + 4, 0
while time.time() < until and not (forwarded and ours and answered):
    if time.time() - asked > 0.5:
        link.mav.heartbeat_send(mavutil.mavlink.MAV_TYPE_GCS, mavutil.mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 0)
        link.mav.param_set_send(SYSTEM, US, b"OUT_NAMED_HZ", 4.0, mavutil.mavlink.MAV_PARAM_TYPE_REAL32)
        asked = time.time()
    message = link.recv_match(blocking=True, timeout=0.2)
    if message is None or message.get_type() == "BAD_DATA" or not message.get_signed():
        continue
    forwarded |= message.get_type() == "ATTITUDE" and message.get_srcComponent() == 1
    ours |= message.get_type() == "HEARTBEAT" and message.get_srcComponent() == US
    answered |= message.get_type() == "PARAM_VALUE" and message.param_value == 4.0
print(f"forwarded: {forwarded}, ours: {ours}, answered: {answered}")
