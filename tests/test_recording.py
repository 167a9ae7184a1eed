"""Owns the tests of `Recording.read`: every format gives the same recording, and each way of being wrong its own error.

One good recording; each test spoils exactly one thing.
"""

from __future__ import annotations

import gzip
import io
import json
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

import ltp
from conftest import DT, HEADER, SAMPLES, rows_of, write_rows

Columns = dict[str, npt.NDArray[np.float64]]


def assert_good(recording: ltp.Recording, good: Columns) -> None:
    np.testing.assert_allclose(recording.t, good["t"], atol=1e-12)
    assert recording.input_names == ["tau", "load"]
    assert recording.output_names == ["q", "v"]
    np.testing.assert_allclose(recording.inputs, np.column_stack([good["tau"], good["load"]]), rtol=1e-12)
    np.testing.assert_allclose(recording.outputs, np.column_stack([good["qm"], good["v"]]), rtol=1e-12)
    assert recording.dt == pytest.approx(DT)
    assert len(recording) == SAMPLES


class TestFormats:
    @pytest.mark.parametrize("delimiter", [",", ";", "\t", " ", " , "])
    def test_delimiters(self, tmp_path: Path, rig: ltp.Model, good: Columns, delimiter: str) -> None:
        path = write_rows(tmp_path / "run.csv", rows_of(good), delimiter)
        assert_good(ltp.Recording.read(path, rig), good)

    def test_gzip_and_name(self, tmp_path: Path, rig: ltp.Model, good: Columns) -> None:
        plain = write_rows(tmp_path / "plain.csv", rows_of(good)).read_bytes()
        path = tmp_path / "run.7.csv.gz"
        path.write_bytes(gzip.compress(plain))
        recording = ltp.Recording.read(path, rig)
        assert_good(recording, good)
        assert recording.name == "run.7"

    @pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
    def test_byte_order_marks(self, tmp_path: Path, rig: ltp.Model, good: Columns, encoding: str) -> None:
        path = write_rows(tmp_path / "run.csv", rows_of(good))
        path.write_bytes(path.read_text(encoding="utf-8").replace("\n", "\r\n").encode(encoding))
        assert_good(ltp.Recording.read(path, rig), good)

    def test_header_written_by_numpy(self, tmp_path: Path, rig: ltp.Model, good: Columns) -> None:
        path = tmp_path / "run.csv"
        np.savetxt(path, np.column_stack(list(good.values())), delimiter=",", header="rig 7\n" + ",".join(HEADER))
        assert_good(ltp.Recording.read(path, rig), good)

    def test_comments_blank_lines_and_trailing_delimiters(self, tmp_path: Path, rig: ltp.Model, good: Columns) -> None:
        rows = [[*row, ""] for row in rows_of(good)]
        rows[0:0] = [["# day 3", "wet"], [""]]
        rows.append([""])
        assert_good(ltp.Recording.read(write_rows(tmp_path / "run.csv", rows), rig), good)

    def test_column_of_remarks_does_no_harm(self, tmp_path: Path, rig: ltp.Model, good: Columns) -> None:
        rows = [["remark", *rows_of(good)[0]], *(['"a, b"', *row] for row in rows_of(good)[1:])]
        assert_good(ltp.Recording.read(write_rows(tmp_path / "run.csv", rows), rig), good)

    def test_npz(self, tmp_path: Path, rig: ltp.Model, good: Columns) -> None:
        path = tmp_path / "run.npz"
        objects = np.array([{"a": 1}], dtype=object)
        np.savez(path, gain=np.float64(3.0), note=np.array("text"), objects=objects, **good)
        assert_good(ltp.Recording.read(path, rig), good)

    def test_npz_matrix_columns_count_from_zero(self, tmp_path: Path, rig: ltp.Model, good: Columns) -> None:
        path = tmp_path / "run.npz"
        np.savez(path, t=good["t"], y=np.column_stack([good["qm"], good["v"]]), tau=good["tau"], load=good["load"])
        assert_good(ltp.Recording.read(path, rig, {"q": "y[0]", "v": "y[1]"}), good)

    def test_json_samples_with_numbers_beside_them(self, tmp_path: Path, rig: ltp.Model, good: Columns) -> None:
        samples = [{key: float(good[key][i]) for key in ("t", "tau", "qm", "v")} for i in range(len(good["t"]))]
        samples[3]["v"] = None  # type: ignore[assignment]
        log = {"load": 0.25, "motor": "m", "samples": samples}
        (tmp_path / "log.json").write_text(json.dumps(log))
        recording = ltp.Recording.read(tmp_path / "log.json", rig)
        assert np.array_equal(recording.inputs[:, recording.input_names.index("load")], np.full(len(good["t"]), 0.25))
        assert np.flatnonzero(np.isnan(recording.outputs[:, 1])).tolist() == [3]
        (tmp_path / "log.json").write_text(json.dumps(samples))
        assert "load" not in ltp.Recording.read(tmp_path / "log.json", rig).input_names

    def test_json_lists_of_numbers(self, tmp_path: Path, rig: ltp.Model, good: Columns) -> None:
        log = {key: values.tolist() for key, values in good.items()} | {"who": "me", "remarks": ["a", "b"]}
        (tmp_path / "log.json").write_text(json.dumps(log))
        assert_good(ltp.Recording.read(tmp_path / "log.json", rig), good)

    def test_json_that_is_no_log(self, tmp_path: Path, rig: ltp.Model) -> None:
        path = tmp_path / "log.json"
        for text, message in (
            ("{", "not readable as JSON"),
            ("3", "no samples in it"),
            ('{"a": 1}', "no samples in it"),
            ('{"a": [{"t": 1}], "b": [{"t": 1}]}', "'a', 'b' hold samples"),
        ):
            path.write_text(text)
            with pytest.raises(ltp.InputError, match=message):
                ltp.Recording.read(path, rig)

    def test_mat(self, tmp_path: Path, rig: ltp.Model, good: Columns) -> None:
        io_module = pytest.importorskip("scipy.io")
        path = tmp_path / "run.mat"
        other = {"T": 0.1, "leg": "inner", "state": {"a": 1.0}, "tout": np.arange(7.0)}
        io_module.savemat(path, {**{name: values[:, None] for name, values in good.items()}, **other})
        assert_good(ltp.Recording.read(path, rig), good)

    def test_mat_matrix_columns_count_from_one(self, tmp_path: Path, rig: ltp.Model, good: Columns) -> None:
        io_module = pytest.importorskip("scipy.io")
        path = tmp_path / "run.mat"
        matrix = np.column_stack([good["qm"], np.degrees(good["v"])])
        io_module.savemat(path, {"y": matrix, "t": good["t"], "tau": good["tau"], "load": good["load"]})
        recording = ltp.Recording.read(path, rig, {"q": "y[1]", "v": "y[2] [m/s]"})
        np.testing.assert_allclose(recording.outputs, matrix)

    def test_mat_of_version_7_3(self, tmp_path: Path, rig: ltp.Model, good: Columns) -> None:
        h5py = pytest.importorskip("h5py")
        path = tmp_path / "run.mat"
        with h5py.File(path, "w", userblock_size=512) as file:
            for name, values in good.items():
                file[name] = values[None, :]
            file["leg"] = np.array([[105, 110]], dtype=np.uint16)
            file["leg"].attrs["MATLAB_class"] = np.bytes_("char")
        with path.open("r+b") as stream:
            stream.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512))
        assert_good(ltp.Recording.read(path, rig), good)

    def test_data_frame(self, rig: ltp.Model, good: Columns) -> None:
        class Frame:
            """What pandas and polars have in common, as far as a reader cares."""

            columns = tuple(HEADER)

            def __getitem__(self, name: str) -> list[float]:
                return good[name].tolist()

        assert_good(ltp.Recording.read(Frame(), rig, name="frame"), good)

    def test_pandas(self, rig: ltp.Model, good: Columns) -> None:
        pandas = pytest.importorskip("pandas")
        assert_good(ltp.Recording.read(pandas.DataFrame(good), rig), good)

    def test_dict_of_arrays(self, rig: ltp.Model, good: Columns) -> None:
        assert_good(ltp.Recording.read(good, rig), good)

    def test_arrays(self, good: Columns) -> None:
        inputs, outputs = {"tau": good["tau"], "load": good["load"]}, {"q": good["qm"], "v": good["v"]}
        assert_good(ltp.Recording(good["t"], inputs, outputs, name="run"), good)


class TestColumns:
    def renamed(self, good: Columns, **names: str) -> Columns:
        return {names.get(name, name): values for name, values in good.items()}

    def test_mapping(self, rig: ltp.Model, good: Columns) -> None:
        data = self.renamed(good, qm="position", tau="u")
        assert_good(ltp.Recording.read(data, rig, {"q": "position", "tau": "u"}), good)

    @pytest.mark.parametrize("header", ["qm [mm]", "qm (mm)", "qm[mm]"])
    def test_unit_in_header(self, rig: ltp.Model, good: Columns, header: str) -> None:
        data = self.renamed(good, qm=header)
        data[header] = 1000 * good["qm"]
        assert_good(ltp.Recording.read(data, rig), good)

    def test_unit_in_mapping(self, rig: ltp.Model, good: Columns) -> None:
        data = {**self.renamed(good, qm="pos"), "pos": 1000 * good["qm"]}
        assert_good(ltp.Recording.read(data, rig, {"q": "pos [mm]"}), good)

    def test_degree_sign(self, good: Columns) -> None:
        model = ltp.Model(
            name="swing",
            states={"theta": {"value": 0.1, "unit": "rad"}},
            flow={"theta": "0"},
            outputs={"theta": {"value": "theta", "unit": "rad"}},
        )
        data = {"t": good["t"], "theta [°]": np.degrees(good["v"])}
        np.testing.assert_allclose(ltp.Recording.read(data, model).outputs[:, 0], good["v"])

    def test_units_that_contradict(self, rig: ltp.Model, good: Columns) -> None:
        with pytest.raises(ltp.InputError, match=r"'qm \[mm\]' says its unit is 'mm'.*says 'm'"):
            ltp.Recording.read(self.renamed(good, qm="qm [mm]"), rig, {"q": "qm [m]"})

    def test_unit_of_another_dimension(self, rig: ltp.Model, good: Columns) -> None:
        with pytest.raises(ltp.InputError, match=r"column 'qm \[s\]', wanted for 'q' in 'm'"):
            ltp.Recording.read(self.renamed(good, qm="qm [s]"), rig)

    @pytest.mark.parametrize("header", ["time", "Time", "t [s]", "TIME (s)"])
    def test_time_aliases(self, rig: ltp.Model, good: Columns, header: str) -> None:
        assert_good(ltp.Recording.read(self.renamed(good, t=header), rig), good)

    def test_time_in_milliseconds(self, rig: ltp.Model, good: Columns) -> None:
        data = {**self.renamed(good, t="time [ms]"), "time [ms]": 1000 * good["t"]}
        assert_good(ltp.Recording.read(data, rig), good)

    def test_time_by_mapping(self, rig: ltp.Model, good: Columns) -> None:
        assert_good(ltp.Recording.read(self.renamed(good, t="clock"), rig, {"t": "clock"}), good)

    def test_dt_instead_of_time(self, rig: ltp.Model, good: Columns) -> None:
        data = {name: values for name, values in good.items() if name != "t"}
        assert_good(ltp.Recording.read(data, rig, dt=DT), good)

    def test_dt_beside_time(self, rig: ltp.Model, good: Columns) -> None:
        with pytest.raises(ltp.InputError, match=r"dt = 0\.1 s is given, but the file has the time column 't'"):
            ltp.Recording.read(good, rig, dt=DT)
        assert_good(ltp.Recording.read(good, rig, {"t": None}, dt=DT), good)

    def test_neither_time_nor_dt(self, rig: ltp.Model, good: Columns) -> None:
        with pytest.raises(ltp.InputError, match=r"no column 't' for the time.*--dt"):
            ltp.Recording.read(self.renamed(good, t="x"), rig)

    @pytest.mark.parametrize("dt", [0.0, -0.1, float("nan"), float("inf")])
    def test_dt_that_is_no_period(self, rig: ltp.Model, good: Columns, dt: float) -> None:
        with pytest.raises(ltp.InputError, match="positive number of seconds"):
            ltp.Recording.read(good, rig, {"t": None}, dt=dt)

    def test_input_with_default_may_be_absent(self, rig: ltp.Model, good: Columns) -> None:
        data = {name: values for name, values in good.items() if name != "load"}
        recording = ltp.Recording.read(data, rig)
        assert recording.input_names == ["tau"]  # the model's default stands in where the recording is used
        assert not recording.warnings

    def test_output_that_was_not_recorded(self, rig: ltp.Model, good: Columns) -> None:
        data = {name: values for name, values in good.items() if name != "v"}
        assert ltp.Recording.read(data, rig, {"v": None}).output_names == ["q"]

    def test_no_output_at_all(self, rig: ltp.Model, good: Columns) -> None:
        with pytest.raises(ltp.InputError, match="no output of the model"):
            ltp.Recording.read(good, rig, {"v": None, "q": None})

    def test_no_such_column_shows_the_nearest(self, tmp_path: Path, rig: ltp.Model, good: Columns) -> None:
        path = write_rows(tmp_path / "run.csv", rows_of(self.renamed(good, tau="Tau1")))
        with pytest.raises(ltp.InputError, match=r"run\.csv: no column 'tau' for the input 'tau'; nearest: 'Tau1'"):
            ltp.Recording.read(path, rig)

    def test_mapping_of_an_unknown_name(self, rig: ltp.Model, good: Columns) -> None:
        with pytest.raises(ltp.InputError, match="'rig' has no input or output 'taw'; did you mean tau"):
            ltp.Recording.read(good, rig, {"taw": "tau"})

    def test_column_that_appears_twice(self, tmp_path: Path, rig: ltp.Model, good: Columns) -> None:
        rows = [[*row, row[1]] for row in rows_of(good)]
        with pytest.raises(ltp.InputError, match="2 columns fit 'tau'"):
            ltp.Recording.read(write_rows(tmp_path / "run.csv", rows), rig)


class TestCells:
    """One cell of a good CSV file is spoiled; the error names file, row (the header is row 1) and column."""

    @pytest.fixture
    def spoil(self, tmp_path: Path, rig: ltp.Model, good: Columns) -> Callable[[int, str, str], ltp.Recording]:
        def read_with(row: int, column: str, cell: str) -> ltp.Recording:
            rows = rows_of(good)
            rows[row - 1][HEADER.index(column)] = cell
            return ltp.Recording.read(write_rows(tmp_path / "run.csv", rows), rig)

        return read_with

    @pytest.mark.parametrize("text", ["abc", "1.2.3", "1_0", "12:30:00"])
    def test_text(self, spoil: Callable[[int, str, str], ltp.Recording], text: str) -> None:
        with pytest.raises(ltp.InputError, match=rf"run\.csv: row 7, column 'tau': found the text '{text}' where"):
            spoil(7, "tau", text)

    def test_decimal_comma(self, tmp_path: Path, rig: ltp.Model, good: Columns) -> None:
        rows = rows_of(good)
        rows[1:] = [[cell.replace(".", ",") for cell in row] for row in rows[1:]]
        with pytest.raises(ltp.InputError, match=r"row 2.*decimal point, not a comma"):
            ltp.Recording.read(write_rows(tmp_path / "run.csv", rows, ";"), rig)

    @pytest.mark.parametrize("text", ["inf", "-Infinity", "1e999"])
    def test_infinite(self, spoil: Callable[[int, str, str], ltp.Recording], text: str) -> None:
        with pytest.raises(ltp.InputError, match=r"run\.csv: row 5, column 'qm': infinite value"):
            spoil(5, "qm", text)

    @pytest.mark.parametrize("text", ["", "NaN", "n/a"])
    def test_missing_output_is_a_gap(self, spoil: Callable[[int, str, str], ltp.Recording], text: str) -> None:
        outputs = spoil(6, "qm", text).outputs
        assert np.isnan(outputs[4, 0])
        assert np.isnan(outputs).sum() == 1

    def test_missing_input(self, spoil: Callable[[int, str, str], ltp.Recording]) -> None:
        with pytest.raises(ltp.InputError, match=r"run\.csv: row 6, column 'tau': no value of an input"):
            spoil(6, "tau", "")

    def test_missing_time(self, spoil: Callable[[int, str, str], ltp.Recording]) -> None:
        with pytest.raises(ltp.InputError, match=r"run\.csv: row 6, column 't': no time"):
            spoil(6, "t", "")

    def test_time_runs_back(self, spoil: Callable[[int, str, str], ltp.Recording]) -> None:
        with pytest.raises(ltp.InputError, match=r"row 6, column 't': time runs back: 0\.15 s after 0\.3 s in row 5"):
            spoil(6, "t", "0.15")

    def test_time_stands_still(self, spoil: Callable[[int, str, str], ltp.Recording]) -> None:
        with pytest.raises(ltp.InputError, match="row 6, column 't': time stands still"):
            spoil(6, "t", "0.3")

    def test_row_numbers_count_comments(self, tmp_path: Path, rig: ltp.Model, good: Columns) -> None:
        rows = rows_of(good)
        rows[3][1] = "abc"
        with pytest.raises(ltp.InputError, match="row 6, column 'tau'"):
            ltp.Recording.read(write_rows(tmp_path / "run.csv", [["# one"], [""], *rows]), rig)

    def test_unequal_lengths(self, tmp_path: Path, rig: ltp.Model, good: Columns) -> None:
        rows = rows_of(good)
        del rows[8][-1]
        with pytest.raises(ltp.InputError, match=r"run\.csv: row 9: 4 cells, but the header names 5 columns"):
            ltp.Recording.read(write_rows(tmp_path / "run.csv", rows), rig)

    def test_open_quotation_mark(self, spoil: Callable[[int, str, str], ltp.Recording]) -> None:
        with pytest.raises(ltp.InputError, match=r"run\.csv: row 9: a quotation mark"):
            spoil(9, "v", '"0.1')

    def test_unequal_lengths_of_arrays(self, rig: ltp.Model, good: Columns) -> None:
        with pytest.raises(ltp.InputError, match=r"unequal length.*'tau' has 19"):
            ltp.Recording.read({**good, "tau": good["tau"][1:]}, rig)

    def test_complex_values(self, rig: ltp.Model, good: Columns) -> None:
        with pytest.raises(ltp.InputError, match="column 'qm' holds complex numbers"):
            ltp.Recording.read({**good, "qm": good["qm"] + 1j}, rig)

    def test_dates_are_no_seconds(self, rig: ltp.Model, good: Columns) -> None:
        dates = np.datetime64("2024-01-01") + np.arange(SAMPLES).astype("timedelta64[s]")
        with pytest.raises(ltp.InputError, match="column 't' holds values of type datetime64"):
            ltp.Recording.read({**good, "t": dates}, rig)  # type: ignore[dict-item]

    def test_jitter_is_resampled_with_a_warning(self, rig: ltp.Model, good: Columns) -> None:
        jitter = 0.01 * np.sin(7 * np.arange(SAMPLES))
        with pytest.warns(UserWarning, match="jitter"):
            recording = ltp.Recording.read({**good, "t": good["t"] + jitter}, rig)
        assert any("jitter" in text for text in recording.warnings)


class TestFiles:
    """A file as a whole is wrong."""

    def check(self, path: Path, content: bytes | None, rig: ltp.Model, message: str) -> None:
        if content is not None:
            path.write_bytes(content)
        with pytest.raises(ltp.InputError, match=message) as caught:
            ltp.Recording.read(path, rig)
        assert path.name in str(caught.value)

    def test_missing(self, tmp_path: Path, rig: ltp.Model) -> None:
        self.check(tmp_path / "run.csv", None, rig, "no such file")

    def test_folder(self, tmp_path: Path, rig: ltp.Model) -> None:
        (tmp_path / "run.csv").mkdir()
        self.check(tmp_path / "run.csv", None, rig, "this is a folder")

    def test_unsupported_suffix(self, tmp_path: Path, rig: ltp.Model) -> None:
        self.check(tmp_path / "run.xlsx", b"PK", rig, r"no reader for '\.xlsx'; recordings end in \.csv")

    @pytest.mark.parametrize("suffix", [".csv", ".csv.gz", ".npz", ".mat"])
    def test_empty(self, tmp_path: Path, rig: ltp.Model, suffix: str) -> None:
        self.check(tmp_path / f"run{suffix}", b"", rig, "the file is empty")

    def test_only_blank_lines(self, tmp_path: Path, rig: ltp.Model) -> None:
        self.check(tmp_path / "run.csv", b"\n  \n\n", rig, "the file is empty")

    @pytest.mark.parametrize("header", [b"t,tau,load,qm,v\n", b"# t,tau,load,qm,v\n"])
    def test_header_only(self, tmp_path: Path, rig: ltp.Model, header: bytes) -> None:
        self.check(tmp_path / "run.csv", header, rig, "a header but no rows")

    def test_one_row(self, tmp_path: Path, rig: ltp.Model) -> None:
        self.check(tmp_path / "run.csv", b"t,tau,load,qm,v\n0,1,2,3,4\n", rig, r"only one row \(row 2\)")

    def test_no_header(self, tmp_path: Path, rig: ltp.Model) -> None:
        self.check(tmp_path / "run.csv", b"0,1,2,3,4\n1,1,2,3,4\n", rig, "row 1: no header.*its 5 columns")

    def test_row_of_units(self, tmp_path: Path, rig: ltp.Model) -> None:
        content = b"t,tau,load,qm,v\ns,N,N,m,m/s\n0,1,2,3,4\n"
        self.check(tmp_path / "run.csv", content, rig, "row 2: not a table of numbers.*row of units")

    def test_binary_rubbish(self, tmp_path: Path, rig: ltp.Model) -> None:
        self.check(tmp_path / "run.csv", bytes(range(256)) * 4, rig, "not a table: binary content")

    def test_gzip_cut_short(self, tmp_path: Path, rig: ltp.Model) -> None:
        whole = gzip.compress(b"t,tau,load,qm,v\n" + b"0,1,2,3,4\n" * 1000)
        self.check(tmp_path / "run.csv.gz", whole[:-12], rig, "gzip data cannot be unpacked")

    def test_gzip_in_name_only(self, tmp_path: Path, rig: ltp.Model) -> None:
        self.check(tmp_path / "run.csv.gz", b"t,tau\n0,1\n", rig, "the content is not gzip")

    def test_npz_rubbish(self, tmp_path: Path, rig: ltp.Model) -> None:
        self.check(tmp_path / "run.npz", b"rubbish", rig, "not a readable .npz archive")

    def test_npz_cut_short(self, tmp_path: Path, rig: ltp.Model, good: Columns) -> None:
        stream = io.BytesIO()
        np.savez(stream, **good)
        self.check(tmp_path / "run.npz", stream.getvalue()[:-40], rig, "not a readable .npz archive")

    def test_npz_single_array(self, tmp_path: Path, rig: ltp.Model) -> None:
        stream = io.BytesIO()
        np.save(stream, np.arange(9.0))
        self.check(tmp_path / "run.npz", stream.getvalue(), rig, "a single array without a name")

    def test_npz_without_signals(self, tmp_path: Path, rig: ltp.Model) -> None:
        stream = io.BytesIO()
        np.savez(stream, note=np.array("text"))
        self.check(tmp_path / "run.npz", stream.getvalue(), rig, "holds no numeric array")

    def test_mat_rubbish(self, tmp_path: Path, rig: ltp.Model) -> None:
        pytest.importorskip("scipy.io")
        self.check(tmp_path / "run.mat", b"rubbish" * 100, rig, "not a readable MAT file")

    def test_mat_without_scipy(self, tmp_path: Path, rig: ltp.Model, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setitem(sys.modules, "scipy.io", None)
        self.check(tmp_path / "run.mat", b"MATLAB 5.0 MAT-file", rig, r"ltp-dynamics\[mat\]")

    def test_mat_of_version_7_3_without_h5py(
        self, tmp_path: Path, rig: ltp.Model, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setitem(sys.modules, "h5py", None)
        self.check(tmp_path / "run.mat", b"MATLAB 7.3 MAT-file".ljust(600), rig, "pip install h5py")

    def test_not_a_source(self, rig: ltp.Model) -> None:
        with pytest.raises(ltp.InputError, match="a path, a data frame or a dict"):
            ltp.Recording.read(3, rig)  # type: ignore[arg-type]


class TestRecording:
    @pytest.fixture
    def recording(self, rig: ltp.Model, good: Columns) -> ltp.Recording:
        return ltp.Recording.read(good, rig, name="run")

    def test_slice_keeps_times(self, recording: ltp.Recording) -> None:
        part = recording.slice(0.5, 1.5)
        assert part.t[0] == pytest.approx(0.5)
        assert part.t[-1] == pytest.approx(1.5)
        assert part.outputs.shape == (11, 2)

    def test_empty_slice(self, recording: ltp.Recording) -> None:
        with pytest.raises(ltp.InputError, match="run"):
            recording.slice(5.0, 6.0)

    def test_repr(self, recording: ltp.Recording) -> None:
        assert "20 samples, 0 to 1.9 s" in repr(recording)

    def test_matrix_for_a_signal(self, good: Columns) -> None:
        with pytest.raises(ltp.InputError, match=r"'q' has shape \(10, 2\), expected \(n,\)"):
            ltp.Recording(good["t"], {}, {"q": good["qm"].reshape(10, 2)})

    def test_unequal_lengths(self, good: Columns) -> None:
        with pytest.raises(ltp.InputError, match="unequal length"):
            ltp.Recording(good["t"], {}, {"q": good["qm"][:-1]})
