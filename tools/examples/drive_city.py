#!/usr/bin/env python3
"""A client to copy: drives a camera along a recorded path through a served world, with movers, and prints or plots what
each frame cost.

It needs Debian's python3-grpcio and python3-protobuf, for --plot python3-matplotlib, and on PYTHONPATH what the build makes
of server/gnomon.proto: build/release/python. Columns are those of `gnomon replay` (docs/columns.md).
"""
import argparse
import bisect
import csv
import math
import sys
import time

try:
    import grpc
    import gnomon_pb2 as v1
    import gnomon_pb2_grpc
except ImportError as missing:
    sys.exit(f"drive_city.py: {missing}; install python3-grpcio and python3-protobuf, and set PYTHONPATH=build/release/python")


class Movers:
    """Recorded motion as a session is told of it: each object is adopted by name, numbered by its place in the recording,
    and posed anew whenever its sample is another one."""

    def __init__(self, path):
        self.tracks = {}  # by name: times, and the poses at these
        with open(path, newline="", encoding="utf-8") as file:
            for row in csv.DictReader(file):
                times, poses = self.tracks.setdefault(row["node_or_mesh"], ([], []))
                times.append(float(row["time"]))
                poses.append(v1.Pose(
                    position=v1.Vector(x=float(row["x"]), y=float(row["y"]), z=float(row["z"])),
                    orientation=v1.Quaternion(x=float(row["qx"]), y=float(row["qy"]), z=float(row["qz"]), w=float(row["qw"])),
                    scale=float(row["scale"])))
        self.told = {}  # by name: the sample that the session was told last

    def tell(self, now, frame):
        for number, (name, (times, poses)) in enumerate(sorted(self.tracks.items())):
            if name not in self.told:
                frame.objects.add(object=number, adopt=v1.Adopt(name=name))
            sample = max(bisect.bisect_right(times, now) - 1, 0)
            if self.told.get(name) != sample:
                self.told[name] = sample
                frame.objects.add(object=number, pose=poses[sample])


def read_path(path):
    """Poses of a TUM trajectory: time, position, orientation."""
    with open(path, encoding="utf-8") as file:
        poses = [tuple(map(float, line.split())) for line in file if line.strip() and not line.startswith("#")]
    if not poses or any(len(pose) != 8 for pose in poses):
        raise ValueError(f"{path}: not a TUM trajectory; give lines of t tx ty tz qx qy qz qw")
    return poses


def requests(world, poses, movers, wants, real_time):
    """What a session is asked: it is opened, and then each pose is a frame."""
    yield v1.SessionRequest(open=v1.OpenSession(world=world))
    begun = time.monotonic()
    for number, (at, x, y, z, qx, qy, qz, qw) in enumerate(poses):
        if real_time:
            time.sleep(max(0.0, at - poses[0][0] - (time.monotonic() - begun)))
        frame = v1.Frame(sequence=number, time=at, wants=wants)
        frame.cameras.add(position=v1.Vector(x=x, y=y, z=z), orientation=v1.Quaternion(x=qx, y=qy, z=qz, w=qw))
        if movers:
            movers.tell(at, frame)
        yield v1.SessionRequest(frame=frame)


def drive(server, asked):
    """The reply to each frame, in order. The server takes no more requests than it has room for."""
    with grpc.insecure_channel(server, options=[("grpc.max_receive_message_length", -1)]) as channel:
        try:
            grpc.channel_ready_future(channel).result(timeout=5)
        except grpc.FutureTimeoutError:
            raise OSError(f"{server}: no server answers there; start `gnomon serve`, or give its address as --server") from None
        for reply in gnomon_pb2_grpc.GnomonStub(channel).Session(asked):
            if reply.HasField("frame"):
                yield reply.frame


def cost(prefix, c):
    return {prefix + "_texels": c.texels, prefix + "_casters": c.casters, prefix + "_triangles": c.triangles, prefix + "_draws": c.draws}


def rows(reply):
    """A row a cascade; `causes` lists what each cause cost: scroll:TEXELS:CASTERS:TRIANGLES:DRAWS and so on."""
    for number, c in enumerate(reply.cascades):
        yield {
            "frame": reply.sequence, "cascade": number, "window_x": c.window_x, "window_y": c.window_y,
            **cost("static", c.total), **cost("active", c.active), **cost("redraw", c.whole),
            "clusters_found": c.clusters_found, "clusters_hidden": c.clusters_hidden, "asleep": int(c.asleep),
            "unknown_texels": c.unknown_texels, "stale_texels": c.stale_texels, "oldest_debt": c.oldest_debt,
            "missing_texels": c.missing_texels, "coarse_texels": c.coarse_texels,
            "frame_chunk_arrivals": reply.chunk_arrivals, "frame_chunk_departures": reply.chunk_departures,
            "frame_chunk_refinements": reply.chunk_refinements, "frame_chunks_missing": reply.missing_chunks,
            "frame_chunks_coarse": reply.coarse_chunks, "frame_bytes_read": reply.bytes_read,
            "frame_resident_bytes": reply.resident_bytes, "frame_geometry_bytes": reply.geometry_bytes,
            "frame_bytes_uploaded": reply.bytes_uploaded, "frame_rays": reply.rays, "frame_certificates": reply.certificates,
            "frame_revocations": reply.revocations, "plan_hash": f"{reply.plan_hash:016x}",
            "cache_hash": f"{c.cache_hash:016x}", "working_hash": f"{c.working_hash:016x}",
            "causes": ";".join(f"{k.cause}:{k.cost.texels}:{k.cost.casters}:{k.cost.triangles}:{k.cost.draws}" for k in c.causes),
        }


def plot(replies, poses, title, picture):
    """Triangles by cause beside a whole redraw's, and times, over the path's time."""
    import matplotlib
    matplotlib.use("Agg")
    from matplotlib import pyplot

    at = [poses[r.sequence][0] for r in replies]
    causes = {}
    for i, reply in enumerate(replies):
        for c in reply.cascades:
            for k in c.causes:
                causes.setdefault(k.cause, [0] * len(replies))[i] += k.cost.triangles
    figure, (cost_axes, time_axes) = pyplot.subplots(2, 1, sharex=True, figsize=(10, 7), constrained_layout=True)
    figure.suptitle(title)
    cost_axes.plot(at, [sum(c.whole.triangles for c in r.cascades) for r in replies], "k--", linewidth=1, label="drawing everything")
    for name, triangles in sorted(causes.items(), key=lambda item: -sum(item[1])):
        cost_axes.plot(at, [n or math.nan for n in triangles], ".", markersize=3, label=name)
    cost_axes.plot(at, [sum(c.active.triangles for c in r.cascades) or math.nan for r in replies], "tab:gray", linewidth=1, label="movers")
    cost_axes.set(yscale="log", ylabel="triangles a frame")
    time_axes.plot(at, [r.times.advance for r in replies], linewidth=1, label="the frame")
    time_axes.plot(at, [r.times.gpu or math.nan for r in replies], linewidth=1, label="of it, drawing")
    time_axes.set(yscale="log", xlabel="time [s]", ylabel="time a frame [ms]")
    for axes in (cost_axes, time_axes):
        axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=8, frameon=False, fontsize="small")  # above, where it hides nothing
    figure.savefig(picture, dpi=120)


def main():
    parser = argparse.ArgumentParser(description="Drive a camera through a served world.")
    parser.add_argument("world", help="its name, as `gnomon ctl worlds` lists it")
    parser.add_argument("path", help="camera path, TUM trajectory")
    parser.add_argument("--server", default="127.0.0.1:50471", help="HOST:PORT or unix:PATH; %(default)s by default")
    parser.add_argument("--movers", help="recorded motion of objects, CSV")
    parser.add_argument("--seconds", type=float, default=math.inf, help="of the path; all of it by default")
    parser.add_argument("--real-time", action="store_true", help="keep the path's time; as fast as it goes by default")
    parser.add_argument("--plot", metavar="PICTURE", help="chart the cost there (.png, .svg, .pdf) instead of printing rows")
    options = parser.parse_args()
    if options.plot:
        try:
            import matplotlib  # noqa: F401  before the drive, not after it
        except ImportError:
            sys.exit("drive_city.py: --plot needs matplotlib; install python3-matplotlib")
    replies = []
    try:
        poses = read_path(options.path)
        poses = [p for p in poses if p[0] <= poses[0][0] + options.seconds]
        movers = Movers(options.movers) if options.movers else None
        writer = None
        wants = v1.Wants(hashes=not options.plot, gpu_time=bool(options.plot), whole_redraws=True)
        for reply in drive(options.server, requests(options.world, poses, movers, wants, options.real_time)):
            for error in reply.errors:
                print(f"frame {reply.sequence}: {error.what}", file=sys.stderr)
            if options.plot:
                replies.append(reply)
                continue
            for row in rows(reply):
                if not writer:
                    writer = csv.DictWriter(sys.stdout, row, lineterminator="\n")
                    writer.writeheader()
                writer.writerow(row)
    except grpc.RpcError as error:
        sys.exit(f"drive_city.py: {options.server}: {error.details()}")
    except (OSError, KeyError, ValueError) as error:
        sys.exit(f"drive_city.py: {error}")
    if options.plot:
        plot(replies, poses, f"{options.world}: what {len(replies)} frames cost", options.plot)


if __name__ == "__main__":
    main()
