# Source this file: it keeps another Python (conda, pyenv, an active venv, environment modules) from
# misleading later commands. The distribution's compiler, pkg-config and mpirun come first in PATH,
# because its dolfinx compiles forms with them.
unset PYTHONHOME PYTHONPATH PYTHONSTARTUP PYTHONUSERBASE PYTHONPLATLIBDIR VIRTUAL_ENV
unset PYTHONDONTWRITEBYTECODE # without bytecode each process compiles the package anew, 0.8 s
unset CONDA_PREFIX CONDA_DEFAULT_ENV
unset CC CXX CPP CFLAGS CXXFLAGS CPPFLAGS LDFLAGS PKG_CONFIG PKG_CONFIG_PATH PKG_CONFIG_LIBDIR
unset PIP_TARGET PIP_PREFIX PIP_ROOT PIP_PYTHON PIP_CONSTRAINT PIP_REQUIREMENT PIP_NO_DEPS
export PIP_USER=0 PIP_REQUIRE_VIRTUALENV=0
export PATH="/usr/local/sbin:/usr/sbin:/usr/bin:/sbin:/bin:$PATH"
