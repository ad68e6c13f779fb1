"""The interface for programs: a drive or arrays in, out a result that shows, draws and saves itself."""
