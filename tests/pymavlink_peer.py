"""Receives MAVLink on a free UDP port and prints every message as pymavlink decodes it, one JSON object a line.

The first line is the port. Messages of our own dialect go through the module that mavgen made of it (argument 1), all
others through pymavlink's ardupilotmega. Ends when nothing has come for two seconds.
"""

import importlib.util
import json
import math
import socket
import sys

from pymavlink.dialects.v20 import ardupilotmega

spec = importlib.util.spec_from_file_location("estimates", sys.argv[1])
estimates = importlib.util.module_from_spec(spec)
spec.loader.exec_module(estimates)


def plain(value):
    if isinstance(value, float) and not math.isfinite(value):
        return repr(value)
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    return value


sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
sock.bind(("127.0.0.1", 0))
print(sock.getsockname()[1], flush=True)
ours, standard = estimates.MAVLink(None), ardupilotmega.MAVLink(None)
sock.settimeout(10)
while True:
    try:
        data, _ = sock.recvfrom(2048)
    except socket.timeout:
        break
    sock.settimeout(2)
    message_id = int.from_bytes(data[7:10], "little") if data[0] == 0xFD else data[5]
    parser = ours if message_id in estimates.mavlink_map else standard
    for message in parser.parse_buffer(data) or []:
        fields = {k: plain(v) for k, v in message.to_dict().items() if k != "mavpackettype"}
        line = {
            "name": message.get_type(),
            "system": message.get_srcSystem(),
            "component": message.get_srcComponent(),
            "fields": fields,
        }
        print(json.dumps(line), flush=True)
