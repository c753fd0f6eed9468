"""Opening an FMU file: checking the archive, reading its description, extracting it once by content."""

from __future__ import annotations

import hashlib
import os
import shutil
import tempfile
import zipfile
from dataclasses import dataclass
from pathlib import Path

import fmpy
from fmpy.model_description import ModelDescription

from ..errors import InputError
from ..folders import cache_folder


@dataclass(frozen=True)
class Archive:
    """An FMU on disk: its file, the SHA-256 of its bytes, the folder it is extracted to, its description."""

    file: Path
    sha256: str
    folder: Path
    description: ModelDescription

    @property
    def name(self) -> str:
        """File name, for messages."""
        return self.file.name


def open_archive(file: Path) -> Archive:
    """Check and extract the FMU ``file``; a second call with the same bytes finds the first one's folder.

    One folder per content also keeps compiled code that lies beside an FMU's sources. Raises
    :class:`InputError` where the file is missing, not an FMU, or without a binary for this platform.
    """
    if not file.is_file():
        raise InputError(f"There is no file {file}. Give the path of an FMU (a .fmu file).")
    sha256 = hashlib.sha256(file.read_bytes()).hexdigest()
    description = _describe(file)
    if description.coSimulation is None or description.fmiVersion != "2.0":
        raise InputError(
            f"{file.name} is not an FMI 2.0 co-simulation FMU (FMI {description.fmiVersion}). "
            "Export it again as FMI 2.0 co-simulation."
        )
    platforms = fmpy.supported_platforms(str(file))
    if fmpy.platform not in platforms:
        raise InputError(
            f"{file.name} has no binary for this platform, {fmpy.platform}; it has "
            f"{', '.join(platforms) or 'none'}. Export it for {fmpy.platform}."
        )
    return Archive(file, sha256, _extract(file, sha256), description)


def _describe(file: Path) -> ModelDescription:
    try:
        return fmpy.read_model_description(str(file))
    except zipfile.BadZipFile:
        raise InputError(f"{file.name} is not an FMU: it is no zip archive. Export the controller again.") from None
    except KeyError:
        raise InputError(f"{file.name} is not an FMU: the archive has no modelDescription.xml.") from None
    except Exception as problem:  # FMPy raises bare Exceptions for everything a description can get wrong
        raise InputError(f"The modelDescription.xml of {file.name} cannot be used: {problem}") from problem


def _extract(file: Path, sha256: str) -> Path:
    """The folder with the archive's files. It appears under its final name complete or not at all."""
    folder = cache_folder() / "fmus" / sha256
    if folder.is_dir():
        return folder
    folder.parent.mkdir(parents=True, exist_ok=True)
    scratch = Path(tempfile.mkdtemp(prefix="incomplete-", dir=folder.parent))
    try:
        fmpy.extract(str(file), str(scratch / "fmu"))
        os.rename(scratch / "fmu", folder)
    except OSError:
        if not folder.is_dir():  # else another process was first
            raise
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
    return folder
