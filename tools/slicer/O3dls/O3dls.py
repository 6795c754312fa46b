"""The panel of the module O3dls in 3D Slicer. It only asks and shows; what is done stands in o3dls_slicer,
which has no Qt and is tested without the application.
"""

import tempfile
from pathlib import Path

import qt
import slicer
from o3dls_slicer.case import Chosen, InputError, write_case
from o3dls_slicer.job import Job, NotFound, commands, find_python, scene_of
from o3dls_slicer.result import load_scene
from slicer.ScriptedLoadableModule import (
    ScriptedLoadableModule,
    ScriptedLoadableModuleLogic,
    ScriptedLoadableModuleWidget,
)

SETTING = "O3dls/Python"
POLL = 300  # ms


class O3dls(ScriptedLoadableModule):
    """The module says what it is."""

    def __init__(self, parent):
        super().__init__(parent)
        parent.title = "O3dls: fuse an atrium with its map"
        parent.categories = ["Cardiac"]
        parent.contributors = ["the authors of o3dls"]
        parent.helpText = (
            "Registers the surface of an atrium to the points of an electroanatomic map by o3dls, which runs "
            "in a Python environment of its own. Research software, not for clinical use."
        )


class O3dlsLogic(ScriptedLoadableModuleLogic):
    """The logic holds the job that runs, and the folder that it works in."""

    def start(self, chosen, named):
        environment = slicer.util.startupEnvironment()
        python, version = find_python(named, environment)
        self.folder = Path(tempfile.mkdtemp(prefix="o3dls_", dir=slicer.app.temporaryPath))
        write_case(self.folder / "case", chosen)
        self.job = Job(commands(python, self.folder / "case", self.folder / "run"), environment)
        return f"o3dls {version} of {python}"

    def load(self):
        return load_scene(slicer.mrmlScene, scene_of(self.folder / "run"), self.folder / "scene")


class O3dlsWidget(ScriptedLoadableModuleWidget):
    """The panel lets nodes be chosen, starts the job and shows what it says."""

    def setup(self):
        super().setup()
        self.logic = O3dlsLogic()
        form = qt.QFormLayout()
        points = ["vtkMRMLMarkupsFiducialNode", "vtkMRMLTableNode", "vtkMRMLModelNode"]
        marks = ["vtkMRMLMarkupsFiducialNode"]
        self.prior = self._add_selector(form, "Prior", ["vtkMRMLModelNode", "vtkMRMLSegmentationNode"])
        self.segment = qt.QComboBox()
        form.addRow("Segment", self.segment)
        self.prior.connect("currentNodeChanged(vtkMRMLNode*)", self._list_segments)
        self.points = self._add_selector(form, "Points", points)
        self.ablation = self._add_selector(form, "Ablation sites", marks)
        self.on_prior = self._add_selector(form, "Landmarks of the prior", marks)
        self.on_map = self._add_selector(form, "Landmarks of the map", marks)
        self.python = qt.QLineEdit(slicer.app.userSettings().value(SETTING, ""))
        self.python.placeholderText = "found by O3DLS_PYTHON or PATH"
        form.addRow("Python with o3dls", self.python)
        self.button = qt.QPushButton("Register")
        self.button.connect("clicked()", self._start_or_cancel)
        self.said = qt.QPlainTextEdit()
        self.said.readOnly = True
        form.addRow(self.button)
        form.addRow(self.said)
        self.layout.addLayout(form)
        self.timer = qt.QTimer()
        self.timer.interval = POLL
        self.timer.connect("timeout()", self._follow)

    def cleanup(self):
        self.timer.stop()

    def _add_selector(self, form, label, kinds):
        selector = slicer.qMRMLNodeComboBox()
        selector.nodeTypes = kinds
        selector.noneEnabled = True
        selector.addEnabled = selector.removeEnabled = False
        selector.setMRMLScene(slicer.mrmlScene)
        form.addRow(label, selector)
        return selector

    def _list_segments(self, node):
        self.segment.clear()
        if node is not None and node.IsA("vtkMRMLSegmentationNode"):
            parts = node.GetSegmentation()
            for k in range(parts.GetNumberOfSegments()):
                name = parts.GetNthSegmentID(k)
                self.segment.addItem(parts.GetSegment(name).GetName(), name)

    def _start_or_cancel(self):
        if self.timer.active:
            self.logic.job.cancel()
            return
        slicer.app.userSettings().setValue(SETTING, self.python.text)
        chosen = Chosen(
            self.prior.currentNode(),
            self.points.currentNode(),
            self.segment.currentData or "",
            self.ablation.currentNode(),
            self.on_prior.currentNode(),
            self.on_map.currentNode(),
        )
        self.said.clear()
        try:
            self.said.appendPlainText(self.logic.start(chosen, self.python.text.strip()))
        except (InputError, NotFound) as error:
            self.said.appendPlainText(str(error))
            return
        self.button.text = "Cancel"
        self.timer.start()

    def _follow(self):
        job = self.logic.job
        running = job.running  # first: what is said until then is not missed
        for line in job.lines():
            self.said.appendPlainText(line)
        if running:
            return
        self.timer.stop()
        self.button.text = "Register"
        if job.failure:
            self.said.appendPlainText(f"failed: {job.failure}")
            return
        nodes = self.logic.load()
        valid = "" if job.valid else "; THE RESULT IS NOT VALID, see above"
        report = self.logic.folder / "run/report.html"
        self.said.appendPlainText(f"loaded {len(nodes)} nodes; report: {report}{valid}")
