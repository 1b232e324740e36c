"""The report's luigi tasks. Each calls one function of `pipeline.evaluation.paper`."""

from __future__ import annotations

from pathlib import Path

from z2p_renderer.workflows.process.task_log import log_line
from z2p_renderer.workflows.report.report_task import ReportTask


class Measure(ReportTask):
    """One method's pictures and metrics on one sweep of one mesh."""

    stage = "measure"

    def make(self, out: Path) -> None:
        from z2p_renderer.pipeline.evaluation.paper.cases.sweeps import read_true_mesh
        from z2p_renderer.pipeline.evaluation.paper.measure import measure

        part, config = self.part, self.report.config
        if part.method is None:
            raise ValueError(f"{part.name} has no method")
        subject = read_true_mesh(part.mesh.name, self.mesh_path()) if part.mesh else None
        measure(part.sweep, subject, part.method, config, self.truth, out, log=log_line)


class Scans(ReportTask):
    """One method's pictures of real scans."""

    stage = "scans"

    def make(self, out: Path) -> None:
        from z2p_renderer.pipeline.evaluation.paper.real_scans import draw_scans

        if self.part.method is None:
            raise ValueError(f"{self.part.name} has no method")
        draw_scans(self.part.method, self.report.scans, self.report.config, self.truth, out, log=log_line)
        self._check_files()  # again, because the scans were read one after another, long after the first check


class Trust(ReportTask):
    """Uncertainty maps, and how well they predict where a picture is wrong."""

    stage = "trust"

    def make(self, out: Path) -> None:
        from z2p_renderer.pipeline.evaluation.paper.cases.sweeps import read_true_mesh
        from z2p_renderer.pipeline.evaluation.paper.uncertainty import measure_uncertainty

        part = self.part
        if part.method is None or part.mesh is None:
            raise ValueError(f"{part.name} has no method or no mesh")
        subject = read_true_mesh(part.mesh.name, self.mesh_path())
        measure_uncertainty(subject, part.method, self.report.config, self.truth, out, log=log_line)


class Times(ReportTask):
    """The run times of Tables 2 and 3, all measured by one task."""

    stage = "times"

    def make(self, out: Path) -> None:
        from z2p_renderer.pipeline.evaluation.paper.cases.sweeps import read_true_mesh
        from z2p_renderer.pipeline.evaluation.paper.timing import measure_times

        mesh = self.part.mesh
        if mesh is None:
            raise ValueError(f"{self.part.name} has no mesh")
        subject = read_true_mesh(mesh.name, self.mesh_path())
        measure_times(subject, self.report.methods, self.report.config, out, log=log_line)


class Report(ReportTask):
    """The report: HTML, JSON and CSV."""

    stage = "report"

    def make(self, out: Path) -> None:
        from z2p_renderer.pipeline.evaluation.paper.page.report import write_report

        folders = {name: self.store.folder(self.steps[name].entry) for name in self.step.upstream}
        write_report(folders, self.report.methods, self.report.config, self.report.command, out)
