# Puts printctl into the Start menu: it opens the page, its workspace is Documents\printctl.
# Not tried on a real machine.
$ErrorActionPreference = "Stop"
Get-Command printctl | Out-Null  # stops here where pipx has put nothing on the path
$folder = Join-Path ([Environment]::GetFolderPath("MyDocuments")) "printctl"
New-Item -ItemType Directory -Force -Path $folder | Out-Null
$menu = [Environment]::GetFolderPath("Programs")
$link = (New-Object -ComObject WScript.Shell).CreateShortcut((Join-Path $menu "printctl.lnk"))
$link.TargetPath = (Get-Command powershell).Source
$link.Arguments = '-NoExit -Command "$env:PYTHONUTF8=1; printctl serve --open"'
$link.WorkingDirectory = $folder
$link.Save()
