"""Shared caches for the tests: a folder, or S3 by moto behind a proxy that can be slow, dead or read-only."""

import http.client
import http.server
import os
import shutil
import socket
import subprocess
import threading
import time
import urllib.parse
import xml.etree.ElementTree

BUCKET = "levels"
# moto takes requests without credentials for those of strangers. It does not look at the signature.
OWNER = {"Authorization": "AWS4-HMAC-SHA256 Credential=test/20200101/us-east-1/s3/aws4_request, SignedHeaders=host, Signature=0"}


def free_port():
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        return listener.getsockname()[1]


class Folder:
    """A folder as on a file server. Its faults are those of files."""

    kind = "folder"

    def __init__(self, path):
        self.path, self.address, self.environment, self.requests = path, str(path), {}, None
        path.mkdir(parents=True)

    def names(self, kind):
        return sorted(str(p.relative_to(self.path)) for p in (self.path / "simpliguard-v1" / kind).glob("*/*"))

    def read(self, name):
        return (self.path / name).read_bytes()

    def write(self, name, content):
        (self.path / name).write_bytes(content)

    def stop(self):
        self.path.rename(self.path.with_suffix(".away"))

    def start(self):
        # What a request has written that was under way.
        shutil.rmtree(self.path, ignore_errors=True)
        self.path.with_suffix(".away").rename(self.path)

    def close(self):
        shutil.rmtree(self.path, ignore_errors=True)


class S3:
    """moto behind a proxy."""

    kind = "s3"

    def __init__(self, log):
        self.port, self.proxy_port = free_port(), free_port()
        self.address = f"s3://{BUCKET}/farm"
        self.environment = {"AWS_ENDPOINT": f"http://127.0.0.1:{self.proxy_port}", "AWS_ALLOW_HTTP": "true",
                            "AWS_ACCESS_KEY_ID": "test", "AWS_SECRET_ACCESS_KEY": "test", "AWS_REGION": "us-east-1"}
        self.delay, self.read_only, self.dead, self.requests = 0.0, False, False, 0
        self.server = subprocess.Popen(["moto_server", "-H", "127.0.0.1", "-p", str(self.port)], stdout=log, stderr=log)
        for _ in range(200):
            try:
                self.direct("PUT", "")
                break
            except OSError:
                time.sleep(0.1)
        self.proxy = http.server.ThreadingHTTPServer(("127.0.0.1", self.proxy_port), self.handler())
        threading.Thread(target=self.proxy.serve_forever, daemon=True).start()

    def direct(self, method, name, body=None):
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=30)
        connection.request(method, f"/{BUCKET}{'/' + urllib.parse.quote(name) if name else ''}", body, OWNER)
        answer = connection.getresponse()
        content = answer.read()
        if answer.status >= 300:
            raise OSError(f"{method} {name}: {answer.status} {content[:200]}")
        return content

    def handler(self):
        outer = self

        class Handler(http.server.BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def forward(self):
                body = self.rfile.read(int(self.headers.get("Content-Length") or 0))
                outer.requests += 1
                time.sleep(outer.delay)
                if outer.dead:
                    self.close_connection = True
                    return
                if outer.read_only and self.command == "PUT":
                    content = b"<Error><Code>AccessDenied</Code></Error>"
                    self.answer(403, {"Content-Type": "application/xml"}, content)
                    return
                connection = http.client.HTTPConnection("127.0.0.1", outer.port, timeout=30)
                headers = {k: v for k, v in self.headers.items() if k.lower() != "connection"}
                connection.request(self.command, self.path, body, headers)
                answer = connection.getresponse()
                content = answer.read()
                kept = {k: v for k, v in answer.getheaders()
                        if k.lower() not in ("connection", "transfer-encoding", "content-length")}
                size = answer.getheader("Content-Length") if self.command == "HEAD" else None
                self.answer(answer.status, kept, content, size)

            def answer(self, status, headers, content, size=None):
                self.send_response(status)
                for name, value in headers.items():
                    self.send_header(name, value)
                self.send_header("Content-Length", size or str(len(content)))
                self.end_headers()
                self.wfile.write(content)

            do_GET = do_PUT = do_HEAD = do_POST = do_DELETE = forward

            def log_message(self, *_):
                pass

        return Handler

    def names(self, kind):
        return sorted(self.list(f"farm/simpliguard-v1/{kind}/"))

    def list(self, prefix):
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=30)
        connection.request("GET", f"/{BUCKET}?list-type=2&prefix={urllib.parse.quote(prefix)}", None, OWNER)
        tree = xml.etree.ElementTree.fromstring(connection.getresponse().read())
        return [key.text for key in tree.iter() if key.tag.endswith("Key")]

    def read(self, name):
        return self.direct("GET", name)

    def write(self, name, content):
        self.direct("PUT", name, content)

    def stop(self):
        self.dead = True

    def start(self):
        self.dead = False

    def close(self):
        self.proxy.shutdown()
        self.server.terminate()
        self.server.wait()


def open_server(kind, folder, log):
    return Folder(folder) if kind == "folder" else S3(log)


def environment(server, **more):
    """The environment of a process that uses the shared cache."""
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("SIMPLIGUARD_", "AWS_"))}
    return {**kept, **server.environment, **more}
