"""Secure unless set otherwise: nothing listens, nothing searches, nothing is loaded, nothing in a file is run."""

import ast
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

import rwa_monitor
from rwa_monitor.cli.options import warn_if_alone
from rwa_monitor.monitor.bus import BusOptions, open_session, session_config
from rwa_monitor.telemetry.files import MAX_DEPTH
from rwa_monitor.wheel.file_content import MAX_CONTENT_BYTES
from tests.monitor.processes import process, wait_for
from tests.monitor.test_bus import setting
from tests.program import refused

PACKAGE = Path(rwa_monitor.__file__).parent


# ---- the network -----------------------------------------------------------------------------------------------------


def listening(child: subprocess.Popen[str]) -> list[str]:
    """Return the addresses on which a process can be reached: listening TCP, and any UDP."""
    return [
        f"{connection.laddr.ip}"
        for connection in psutil.Process(child.pid).net_connections(kind="inet")
        if connection.status == psutil.CONN_LISTEN or not connection.raddr
    ]


@pytest.mark.processes
def test_run_listens_nowhere_and_searches_for_nobody() -> None:
    with process("run", until="monitoring") as child:
        assert listening(child) == []


@pytest.mark.processes
def test_the_dashboard_listens_on_loopback_only(tmp_path: Path) -> None:
    words = ("dashboard", "--no-browser", "--port", "0", "--record", tmp_path)
    with process(*words, until="the page is at") as child:
        wait_for(lambda: bool(listening(child)), "the page")
        assert set(listening(child)) == {"127.0.0.1"}


LETS_IN = {
    "tcp/127.0.0.1:7447": False,
    "tcp/[::1]:7447": False,
    "tls/0.0.0.0:7447": False,
    "tcp/0.0.0.0:7447": True,
    "udp/[::]:7447": True,
    "0.0.0.0:7447": False,  # refused
}


@pytest.mark.parametrize(("endpoint", "warned"), LETS_IN.items())
def test_an_endpoint_that_lets_everybody_in_is_warned_of(
    endpoint: str, warned: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    warn_if_alone(BusOptions(listen=(endpoint,)))
    assert ("lets in everybody" in capsys.readouterr().err) == warned


def configured(folder: Path, text: str) -> BusOptions:
    (folder / "zenoh.json5").write_text(text)
    return BusOptions(config=folder / "zenoh.json5")


def test_a_configuration_that_names_certificates_listens_nowhere_by_itself(tmp_path: Path) -> None:
    tls = '{ listen_private_key: "/a", listen_certificate: "/b" }'
    options = configured(tmp_path, f'{{ mode: "peer", transport: {{ link: {{ tls: {tls} }} }} }}')
    assert setting(options, "mode") == "peer"
    assert setting(options, "listen/endpoints") == []
    assert setting(options, "scouting/multicast/enabled") is False
    assert setting(options, "scouting/gossip/enabled") is False


def test_each_part_of_a_section_has_its_own_default(tmp_path: Path) -> None:
    rx = "{ buffer_size: 65535 }"
    text = f"{{ scouting: {{ multicast: {{ enabled: true }} }}, transport: {{ link: {{ rx: {rx} }} }} }}"
    options = configured(tmp_path, text)
    assert setting(options, "scouting/multicast/enabled") is True
    assert setting(options, "scouting/gossip/enabled") is False
    assert setting(options, "transport/link/rx/max_message_size") == 2**24


def test_a_configuration_loads_no_plug_in(tmp_path: Path) -> None:
    trace = tmp_path / "loaded"
    library = tmp_path / "libzenoh_plugin_evil.so"
    source = tmp_path / "evil.c"
    source.write_text(
        "#include <fcntl.h>\n"
        f'__attribute__((constructor)) void run(void) {{ open("{trace}", O_CREAT | O_WRONLY, 0600); }}\n'
    )
    subprocess.run(["cc", "-shared", "-fPIC", "-o", str(library), str(source)], check=True)
    search = json.dumps([str(tmp_path)])
    plugin = json.dumps({"__required__": True, "__path__": [str(library)]})
    text = f"{{ plugins_loading: {{ enabled: true, search_dirs: {search} }}, plugins: {{ evil: {plugin} }} }}"
    options = configured(tmp_path, text)
    assert setting(options, "plugins_loading/enabled") is False
    with open_session(options):
        pass
    assert not trace.exists()
    subprocess.run([sys.executable, "-c", f"import ctypes; ctypes.CDLL({str(library)!r})"], check=True)  # the control
    assert trace.exists()


TOO_MUCH = ["[" * (MAX_DEPTH + 1), "{a:" * 100_000, "/* [ */ '{' " + "[{" * MAX_DEPTH, " " * MAX_CONTENT_BYTES + "{}"]


@pytest.mark.parametrize("text", TOO_MUCH)
def test_a_configuration_too_deep_or_too_long_is_refused_before_it_is_parsed(text: str, tmp_path: Path) -> None:
    line = refused(lambda: session_config(configured(tmp_path, text)))
    assert "nested deeper" in line or "larger than" in line


# ---- code ------------------------------------------------------------------------------------------------------------

FORBIDDEN_MODULES = {"pickle", "cPickle", "dill", "cloudpickle", "joblib", "marshal", "shelve", "yaml", "imp", "runpy"}
FROM_JOBLIB = {"Parallel", "cpu_count", "delayed", "parallel_config"}  # processes of our own; its files are pickles
FORBIDDEN_CALLS = {"eval", "exec", "compile", "__import__"}  # re.compile and the like are calls of something else
FORBIDDEN_METHODS = {("os", "system"), ("os", "popen"), ("ctypes", "CDLL"), ("np", "load"), ("numpy", "load")}


def forbidden(node: ast.AST) -> bool:
    """Return whether a piece of code would run what somebody else wrote."""
    if isinstance(node, ast.Import):
        return any(alias.name.split(".")[0] in FORBIDDEN_MODULES for alias in node.names)
    if isinstance(node, ast.ImportFrom):
        if node.module == "joblib" and {alias.name for alias in node.names} <= FROM_JOBLIB:
            return False
        return (node.module or "").split(".")[0] in FORBIDDEN_MODULES
    if not isinstance(node, ast.Call):
        return False
    if any(word.arg == "shell" for word in node.keywords):
        return True
    match node.func:
        case ast.Name(id=name):
            return name in FORBIDDEN_CALLS
        case ast.Attribute(value=ast.Name(id=module), attr=name):
            return (module, name) in FORBIDDEN_METHODS
    return False


def test_the_program_holds_no_pickle_and_runs_no_text() -> None:
    texts = {path: path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py")}
    assert [path for path, text in texts.items() if any(map(forbidden, ast.walk(ast.parse(text))))] == []
    imports = ("import pickle", "from yaml import load", "from joblib import load")
    for control in (*imports, "eval(text)", "os.system(text)", "run(text, shell=True)"):
        assert any(map(forbidden, ast.walk(ast.parse(control))))


# Armed when everything is imported.
WATCH = """
import sys, traceback
from pathlib import Path
from rwa_monitor.cli.main import main

ours = tuple({{str(Path(place).resolve()) for place in (sys.prefix, sys.base_prefix, {package!r})}})
ends = {{
    "pickle.find_class", "marshal.loads", "exec", "compile", "ctypes.dlopen", "os.system", "os.exec", "os.posix_spawn",
    "os.fork", "subprocess.Popen", "socket.connect", "socket.bind", "socket.getaddrinfo",
}}
armed, seen = False, []

def place_of(event, details):
    if event == "exec":
        return details[0].co_filename
    return {{"compile": details[-1], "ctypes.dlopen": details[0]}}.get(event)

def watch(event, details):
    global armed
    if not armed or event not in ends:
        return
    armed = False
    files = [frame.filename for frame in traceback.extract_stack()]
    # Modules are imported late, from where the program lies: they are its own.
    place = place_of(event, details)
    own = place is not None and str(Path(str(place)).resolve()).startswith(ours)
    if not own and not any("importlib" in file for file in files[:-1]):
        seen.append((event, str(place), files[-4:]))
    armed = True

sys.addaudithook(watch)
for command in {commands!r}:
    armed = True
    try:
        main(command, standalone_mode=False)
    except SystemExit:
        pass
    armed = False
if seen:
    raise SystemExit(repr(seen[:3]))
armed = True
import pickle
pickle.loads(b"cposix\\nsystem\\n.")
armed = False
assert [event for event, _, _ in seen] == ["pickle.find_class"], seen  # the control
"""


def test_reading_files_runs_nothing_in_them_and_talks_to_nobody(tmp_path: Path) -> None:
    from rwa_monitor.diagnosis.model import built_in_model
    from rwa_monitor.telemetry.table import table_writer
    from tests.monitor.support import WINDOW, telemetry, wheel

    (tmp_path / "wheel.toml").write_text(wheel().to_toml())
    (tmp_path / "model.json").write_text(built_in_model().to_json())
    for name in ("table.csv", "table.parquet"):
        table_writer(tmp_path / name)(telemetry(WINDOW), tmp_path / name)
    recording = Path(__file__).parents[2] / "replay" / "nominal" / "rwa-000001.mcap"
    options = ["--wheel", str(tmp_path / "wheel.toml"), "--model", str(tmp_path / "model.json"), "--json"]
    commands = [
        ["diagnose", str(tmp_path / "table.csv"), *options],
        ["diagnose", str(tmp_path / "table.parquet"), *options],
        ["replay", str(recording), "--verify"],
        ["recover", str(recording), "-o", str(tmp_path / "out.mcap")],
    ]
    script = WATCH.format(package=str(PACKAGE), commands=commands)
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False, env=os.environ)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count('"verdict"') >= 2
    assert (tmp_path / "out.mcap").exists()


def test_the_page_shows_text_only_as_text() -> None:
    scripts = [path for path in (PACKAGE / "dashboard" / "static").rglob("*.js") if "vendor" not in path.parts]
    assert scripts
    makes_html = re.compile(r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|\beval\b|new Function|javascript:")
    assert [path.name for path in scripts if makes_html.search(path.read_text(encoding="utf-8"))] == []
