"""What a program calls: a drive or arrays in, a result that shows, draws and saves itself."""
