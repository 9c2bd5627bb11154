"""Track an object by the API of `re3 serve`: python examples/client.py VIDEO X,Y,W,H [SERVER]"""

import json
import sys
from pathlib import Path
from urllib.request import Request, urlopen

video, box = Path(sys.argv[1]), [float(number) for number in sys.argv[2].split(",")]
server = sys.argv[3] if len(sys.argv) > 3 else "http://127.0.0.1:8300"


def ask(method, path, body=None):
    data = body if isinstance(body, bytes) or body is None else json.dumps(body).encode()
    headers = {"Content-Type": "application/json"}
    with urlopen(Request(f"{server}/api/sessions{path}", data, headers, method=method)) as answer:
        return json.loads(answer.read() or "null")


session = "/" + ask("POST", "", {"source": "upload", "name": video.name})["id"]
ask("PUT", f"{session}/video", video.read_bytes())
ask("POST", f"{session}/objects", {"box_xywh": box, "name": "object"})
ask("POST", f"{session}/track", {"until": None})
for frame in ask("GET", f"{session}/boxes"):
    for found in frame["results"]:
        print(frame["index"], *found["box_xywh"], found["score"], found["status"])
ask("DELETE", session)
