"""Object code kept on disk: found by other processes, of bounded size, never run if damaged or somebody else's."""

import contextlib
import logging
import os
import subprocess
import sys
import threading

import numpy as np
import pytest

import rne
from rne.__main__ import main
from rne.basics import disk_cache
from rne.kernels import object_code

from .helpers import ROOT
from .random_robots import straight_chain

key = disk_cache.key

pytest.importorskip("llvmlite", reason="Numba is not installed")
OWN = hasattr(os, "getuid")


@pytest.fixture
def place(tmp_path, monkeypatch):
    """An empty cache, and nothing in memory."""
    monkeypatch.setattr(object_code, "RECENT", {})
    monkeypatch.setattr(object_code, "MOST_RECENT", 0)
    monkeypatch.setenv("RNE_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def run_kernel(dynamics=rne.dynamics.gravity_torque):
    kernel = rne.compile(dynamics, straight_chain(2), engine="numba")
    return kernel(np.full((9, 2), 0.3))


@pytest.fixture
def compilations(monkeypatch):
    """Counts them."""
    texts, compiled = [], object_code.compiled
    monkeypatch.setattr(object_code, "compiled", lambda text, loops: texts.append(text) or compiled(text, loops=loops))
    return texts


class TestKernels:
    def test_are_compiled_once(self, place, compilations):
        assert np.array_equal(run_kernel(), run_kernel())
        assert len(compilations) == len(list(place.iterdir())) == 1

    def test_of_other_programs_processors_and_versions_are_others(self, place, compilations, monkeypatch):
        run_kernel()
        rne.compile(rne.dynamics.kinetic_energy, straight_chain(2), engine="numba")(*np.ones((2, 9, 2)))
        monkeypatch.setattr(object_code, "versions", lambda: "others")
        run_kernel()
        monkeypatch.setattr(object_code, "host", lambda: ("another processor", ""))
        run_kernel()
        assert len(compilations) == 4

    def test_without_a_cache_nothing_is_written(self, place, compilations, monkeypatch):
        monkeypatch.setenv("RNE_CACHE", "")
        run_kernel()
        run_kernel()
        assert len(compilations) == 2
        assert not place.exists()

    @pytest.mark.parametrize("damage", [b"", b"short", None])
    def test_damaged_files_are_compiled_anew(self, place, compilations, damage):
        expected = run_kernel()
        (path,) = place.iterdir()
        content = path.read_bytes()
        path.write_bytes(content[:-1] + bytes([content[-1] ^ 1]) if damage is None else damage)
        assert np.array_equal(run_kernel(), expected)
        assert len(compilations) == 2
        assert path.read_bytes() == content

    def test_exchanged_files_are_compiled_anew(self, place, compilations):
        """Called in place of each other they would end the process."""
        expected, other = run_kernel(), run_kernel(dynamics=rne.dynamics.mass_matrix)
        paths = list(place.iterdir())
        contents = [path.read_bytes() for path in paths]
        for path, content in zip(paths, contents[::-1], strict=True):
            path.write_bytes(content)
        assert np.array_equal(run_kernel(), expected)
        assert np.array_equal(run_kernel(dynamics=rne.dynamics.mass_matrix), other)
        assert len(compilations) == 4
        assert [path.read_bytes() for path in paths] == contents

    @pytest.mark.parametrize(
        "what", ["garbage", "nothing", "half", "all but a byte", "another processor's", "another's"]
    )
    def test_what_is_not_this_programs_code_is_compiled_anew(self, place, compilations, what, caplog):
        """Although its digest is right."""
        expected = run_kernel()
        (path,) = place.iterdir()
        content, code = path.read_bytes(), disk_cache.read(path.stem)
        run_kernel(dynamics=rne.dynamics.potential_energy)
        (another,) = set(place.iterdir()) - {path}
        aarch64 = code[:18] + b"\xb7\x00" + code[20:]  # e_machine of an ELF header; of other formats damage as well
        wrong = {"garbage": b"x" * 700, "nothing": b"", "half": code[: len(code) // 2], "all but a byte": code[:-1]}
        wrong |= {"another processor's": aarch64, "another's": disk_cache.read(another.stem)}
        disk_cache.write(path.stem, wrong[what])
        with caplog.at_level(logging.INFO, logger="rne"):
            assert np.array_equal(run_kernel(), expected)
        assert len(compilations) == 3
        assert path.read_bytes() == content
        assert what == "nothing" or f"object code of {path.stem} is compiled anew: " in caplog.text

    @pytest.mark.skipif(not OWN, reason="there are no owners")
    @pytest.mark.parametrize("what", ["folder", "file"])
    def test_what_others_may_write_to_is_refused(self, place, compilations, what, caplog):
        run_kernel()
        (path,) = place.iterdir()
        (place if what == "folder" else path).chmod(0o777)
        with caplog.at_level(logging.WARNING, logger="rne"):
            run_kernel()
        assert len(compilations) == 2
        assert "another user owns it or may write to it" in caplog.text

    @pytest.mark.skipif(not OWN, reason="there are no owners")
    @pytest.mark.parametrize("what", ["folder", "file"])
    def test_a_folder_may_be_a_link_and_a_file_may_not(self, place, compilations, what):
        """Whoever may write where a link leads could exchange the code."""
        run_kernel()
        (path,) = place.iterdir()
        linked = place if what == "folder" else path
        linked.rename(linked.with_name("elsewhere"))
        linked.symlink_to(linked.with_name("elsewhere"))
        run_kernel()
        assert len(compilations) == (1 if what == "folder" else 2)

    @pytest.mark.skipif(not OWN, reason="there are no owners")
    def test_what_another_user_owns_is_refused(self, place, compilations, monkeypatch):
        run_kernel()
        monkeypatch.setattr(os, "getuid", lambda: os.geteuid() + 1)
        run_kernel()
        assert len(compilations) == 2

    def test_a_folder_that_cannot_be_made_is_no_error(self, place, compilations):
        place.write_text("a file")
        run_kernel()
        assert len(compilations) == 1


def test_the_folder_of_windows_is_that_of_the_program_without_an_author(tmp_path, monkeypatch):
    windows = pytest.importorskip("platformdirs.windows")
    monkeypatch.delenv("RNE_CACHE", raising=False)
    monkeypatch.setattr("platformdirs.PlatformDirs", windows.Windows)
    monkeypatch.setattr("platformdirs.windows.get_win_folder", lambda name: str(tmp_path))
    assert disk_cache.folder() == tmp_path / "rne" / "Cache"


def test_the_linker_that_windows_has_links_the_same_code(place, monkeypatch):
    """JITLink is not available there."""
    expected = run_kernel()
    other = object_code.binding.create_lljit_compiler(use_jit_link=False)
    monkeypatch.setattr(object_code, "_linker", lambda: other)
    np.testing.assert_array_equal(run_kernel(), expected)


@pytest.mark.skipif(not OWN, reason="there are no owners")
class TestWhatIsExaminedIsRead:
    """Another user may change a folder's link, or a file, between the two."""

    @pytest.fixture
    def exchanged(self, place, tmp_path, monkeypatch):
        """A link to a folder that becomes one to another folder as soon as the first one was examined."""
        for name, code in (("true", b"code"), ("false", b"foreign")):
            monkeypatch.setenv("RNE_CACHE", str(tmp_path / name))
            disk_cache.write(key("a"), code)
        (tmp_path / "false").chmod(0o777)
        monkeypatch.setenv("RNE_CACHE", str(place))
        place.symlink_to(tmp_path / "true")
        own = disk_cache.is_own

        def examined(*arguments):
            found = own(*arguments)
            place.unlink()
            place.symlink_to(tmp_path / "false")
            monkeypatch.setattr(disk_cache, "is_own", own)
            return found

        monkeypatch.setattr(disk_cache, "is_own", examined)
        return tmp_path

    def test_reading(self, exchanged):
        assert disk_cache.read(key("a")) == b"code"
        assert disk_cache.read(key("a")) is None

    def test_writing(self, exchanged):
        disk_cache.write(key("b"), b"new")
        assert (exchanged / "true" / f"{key('b')}.rne").exists()
        assert not (exchanged / "false" / f"{key('b')}.rne").exists()

    def test_a_pipe_is_not_waited_for_and_a_file_of_more_than_is_kept_is_not_read(self, place):
        place.mkdir(mode=0o700)
        os.mkfifo(place / f"{key('a')}.rne", 0o600)
        (place / f"{key('b')}.rne").touch(0o600)
        os.truncate(place / f"{key('b')}.rne", 2**40)
        assert [disk_cache.read(key(name)) for name in "ab"] == [None, None]


class TestNumbers:
    def loaded(self, mass):
        model = rne.model.with_payload(straight_chain(2), mass, [0.1, 0.2, 0.3])
        return model, rne.compile(rne.dynamics.inverse_dynamics, model, engine="numba")

    def test_programs_that_differ_in_numbers_alone_share_the_code(self, place, compilations):
        q, qd, qdd = np.random.default_rng(0).normal(size=(3, 20, 2))
        for mass in (2.3, 3.7, 2.3):
            model, kernel = self.loaded(mass)
            expected = rne.dynamics.inverse_dynamics(model, q, qd, qdd)
            np.testing.assert_allclose(kernel(q, qd, qdd), expected, rtol=1e-12)
            np.testing.assert_allclose(kernel(q[3], qd[3], qdd[3]), expected[3], rtol=1e-12)
            single = kernel(*(x.astype(np.float32) for x in (q, qd, qdd)))
            np.testing.assert_allclose(single, expected, rtol=1e-4)
        assert len(compilations) == 3  # one state, and batches in two precisions

    def test_kernels_with_numbers_of_their_own_live_beside_one_another(self, place):
        q, qd, qdd = np.random.default_rng(0).normal(size=(3, 20, 2))
        kernels = [self.loaded(mass) for mass in (2.3, 3.7)]
        for _ in range(2):
            for model, kernel in kernels:
                expected = rne.dynamics.inverse_dynamics(model, q, qd, qdd)
                np.testing.assert_allclose(kernel(q, qd, qdd), expected, rtol=1e-12)

    def test_code_is_shared_in_memory_where_there_is_no_folder(self, place, compilations, monkeypatch):
        monkeypatch.setenv("RNE_CACHE", "")
        monkeypatch.setattr(object_code, "MOST_RECENT", 2)
        for mass in (2.3, 3.7):
            self.loaded(mass)[1](*np.ones((3, 9, 2)))
        assert len(compilations) == len(object_code.RECENT) == 1


class TestFiles:
    def test_the_least_recently_used_are_removed(self, place, monkeypatch):
        monkeypatch.setattr(disk_cache, "LIMIT", 10_000)
        for k in range(9):
            disk_cache.write(key(f"{k}"), bytes(1000))
            os.utime(place / f"{key(f'{k}')}.rne", (k, k))
        os.utime(place / f"{key('0')}.rne")  # used again
        disk_cache.write(key("last"), bytes(1000))
        left = {path.stem for path in place.iterdir()}
        assert left == {key(x) for x in ("0", "last", "8", "7", "6", "5", "4")}
        assert disk_cache.read(key("1")) is None
        assert disk_cache.read(key("last")) == bytes(1000)

    def test_a_file_that_cannot_be_finished_leaves_nothing(self, place, monkeypatch, caplog):
        def refuse(*_, **__):
            raise PermissionError(13, "Permission denied")

        monkeypatch.setattr("os.replace", refuse)
        with caplog.at_level(logging.INFO, logger="rne"):
            disk_cache.write("a", b"code")
        assert [*place.iterdir()] == []
        assert f"object code is not kept in {place}: [Errno 13] Permission denied" in caplog.text

    def test_reading_counts_as_use(self, place):
        disk_cache.write("a", b"code")
        os.utime(place / "a.rne", (1, 1))
        disk_cache.read("a")
        assert (place / "a.rne").stat().st_mtime > 1

    def test_writers_and_readers_at_once_see_whole_files(self, place):
        contents, wrong = [bytes([k]) * 100_000 for k in range(4)], []

        def work(k):
            for _ in range(20):
                disk_cache.write("same", contents[k])
                if disk_cache.read("same") not in contents:
                    wrong.append(k)

        threads = [threading.Thread(target=work, args=(k,)) for k in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert not wrong
        assert len(list(place.iterdir())) == 1


@pytest.mark.long  # in one process: TestKernels, and test_engines.py on what imports Numba
def test_a_second_process_needs_no_compiler_and_no_numba(place, tmp_path):
    (tmp_path / "text.py").write_text(
        "def total(x, factor):\n    s = 0.0\n    for i in range(len(x)):\n        s += factor * x[i]\n    return s\n"
    )
    code = (
        "import sys, numpy as np, rne, text; from tests.random_robots import straight_chain;"
        "from rne.integrators import loops; from rne.kernels import object_code;"
        "compiled = object_code.compiled; texts = [];"
        "object_code.compiled = lambda text, loops: texts.append(text) or compiled(text, loops=loops);"
        "kernel = rne.compile(rne.dynamics.gravity_torque, straight_chain(2), engine='numba');"
        "found = kernel(np.ones((9, 2))).sum(), loops.compiled(text.total)(np.arange(4.0), 0.5);"
        "print(repr(found), len(texts), 'numba' in sys.modules)"
    )
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), str(tmp_path)])}
    first, second = (
        subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True).stdout
        for _ in range(2)
    )
    assert first.endswith(" 2 True\n")
    assert second == first.replace(" 2 True", " 0 False")


class TestCommand:
    def test_it_shows_place_size_and_count_and_clears(self, place, capsys):
        assert main(["cache"]) == 0
        assert capsys.readouterr().out == f"{place}: empty\n"
        disk_cache.write(key("a"), bytes(1_500_000))
        disk_cache.write(key("b"), bytes(500_000))
        main(["cache"])
        assert capsys.readouterr().out == f"{place}: 2 files of object code, 2.0 MB of at most 64.0 MB\n"
        main(["cache", "--clear"])
        assert capsys.readouterr().out == f"{place}: 2 files removed\n"
        assert list(place.iterdir()) == []

    def test_files_of_the_user_stay(self, place, monkeypatch):
        """Their names end or begin as those of the cache do; links and folders have even its names."""
        place.mkdir()
        (place / f"{key('folder')}.rne").mkdir()
        for name in ("notes.rne", "unfinished-symphony", "unfinished-" + "x" * 32, f"{key('a')}.txt"):
            (place / name).write_text("mine")
        with contextlib.suppress(OSError):  # on Windows
            (place / f"{key('link')}.rne").symlink_to(place / "notes.rne")
        own = set(place.iterdir())
        monkeypatch.setattr(disk_cache, "LIMIT", 1)
        disk_cache.write(key("a"), b"code")  # too large: removed at once
        assert set(place.iterdir()) == own
        monkeypatch.undo()
        monkeypatch.setenv("RNE_CACHE", str(place))
        disk_cache.write(key("a"), b"code")
        assert disk_cache.clear() == 1
        assert set(place.iterdir()) == own

    def test_without_a_cache_it_says_so(self, monkeypatch, capsys):
        monkeypatch.setenv("RNE_CACHE", "")
        assert main(["cache"]) == 0
        assert capsys.readouterr().out == "no cache: RNE_CACHE is empty\n"
        monkeypatch.delenv("RNE_CACHE")
        monkeypatch.setitem(sys.modules, "platformdirs", None)
        main(["cache", "--clear"])
        assert capsys.readouterr().out == "no cache: platformdirs is not installed: pip install 'rne[numba]'\n"

    @pytest.mark.skipif(not OWN, reason="there are no owners")
    def test_it_says_that_a_folder_is_refused(self, place, capsys):
        place.mkdir()
        place.chmod(0o777)
        main(["cache"])
        assert capsys.readouterr().out == f"{place}: not used, since another user owns it or may write to it\n"
