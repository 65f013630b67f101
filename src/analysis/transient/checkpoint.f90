!> The checkpoint of a transient, results/<deck>/checkpoint: 64-bit words, in turn a mark, digests of the program and of the deck's
!> text with what the command line set, the number of values, the values, a digest of all before. It is written under another name,
!> and renamed when it and the results that it refers to are on the disk. So at any moment there is a complete one or none.
module checkpoint
  use kinds, only: ip
  use archive, only: value_archive
  use errors, only: failure, status_bad_input
  use own_files, only: checkpoint_mark, is_others, remove_own
  use posix, only: close_file, create_file, file_size, open_to_read, remove_scratch, replace_file, sync_file, &
    write_bytes
  use summary, only: version
  use text_checksum, only: digest
  use, intrinsic :: iso_fortran_env, only: compiler_version, compiler_options
  implicit none (type, external)
  private
  public :: write_checkpoint, read_checkpoint, remove_checkpoint

  character(*), parameter :: name = '/checkpoint'
  character(*), parameter :: layout = ' values 10'           !! version of an archive's contents: count up where they change
  integer(ip), parameter :: mark = transfer(checkpoint_mark, 0_ip)   !! first word of every checkpoint
  integer, parameter :: frame = 5                            !! words beside the values

contains

  !> Writes the values of an archive.
  subroutine write_checkpoint(folder, deck_text, settings, a, ok)
    character(*), intent(in) :: folder, deck_text
    character(*), intent(in) :: settings                   !! `! --set NAME=VALUE`, a line each
    type(value_archive), intent(in) :: a
    logical, intent(out) :: ok
    integer(ip), allocatable :: words(:)
    integer :: handle
    logical :: closed
    allocate (words(a%count + frame))
    words(1:4) = [mark, program_digest(), digest(deck_text//settings), a%count]
    words(5:4 + a%count) = a%words(1:a%count)
    words(size(words)) = digest(bytes_of(words(1:size(words) - 1)))
    ok = .not. is_others(folder//name)
    if (.not. ok) return
    handle = create_file(folder//name//'.new')
    ok = handle >= 0
    if (.not. ok) return
    ok = write_bytes(handle, bytes_of(words))
    if (ok) ok = sync_file(handle)
    ok = close_file(handle) .and. ok
    if (ok) ok = replace_file(folder//name//'.new', folder//name)
    handle = open_to_read(folder, wait=0)     ! its names are on the disk
    if (ok) ok = handle >= 0
    if (ok) ok = sync_file(handle)
    if (handle >= 0) closed = close_file(handle)
    if (.not. ok) call remove_scratch(folder//name//'.new')
  end subroutine write_checkpoint

  !> Words as their bytes.
  pure function bytes_of(words) result(bytes)
    integer(ip), intent(in) :: words(:)
    character(8*size(words)) :: bytes
    bytes = transfer(words, bytes)
  end function bytes_of

  !> Digest of the program: a checkpoint of another version or build could not be continued bit for bit.
  function program_digest() result(hash)
    integer(ip) :: hash
    hash = digest(version//layout//' '//compiler_version()//' '//compiler_options())
  end function program_digest

  !> Reads a checkpoint into an archive; refuses one that is missing, damaged, of another program or another deck.
  subroutine read_checkpoint(folder, deck_text, settings, a, fail)
    character(*), intent(in) :: folder, deck_text
    character(*), intent(in) :: settings                   !! `! --set NAME=VALUE`, a line each
    type(value_archive), intent(inout) :: a
    type(failure), intent(inout) :: fail
    integer(ip), allocatable :: words(:)
    integer :: unit, status
    integer(ip) :: bytes, head(4)
    logical :: exists
    inquire (file=folder//name, exist=exists)
    if (.not. exists) then
      call fail%raise(status_bad_input, 'there is no checkpoint to restart from in "'//folder// &
                      '": the run ended well, or never wrote one; run without --restart to start at t = 0')
      return
    end if
    bytes = file_size(folder//name)           ! < 0: no file; a pipe would be waited for
    status = 1
    if (bytes >= 0) open (newunit=unit, file=folder//name, access='stream', form='unformatted', status='old', action='read', &
                          iostat=status)
    if (status == 0) then
      read (unit, iostat=status) head
      if (status == 0 .and. (head(1) /= mark .or. head(4) /= bytes/8 - frame .or. mod(bytes, 8_ip) /= 0)) status = 1
      if (status == 0) allocate (words(bytes/8), stat=status)
      if (status == 0) read (unit, pos=1, iostat=status) words
      close (unit)
    end if
    if (status == 0) then
      if (words(size(words)) /= digest(bytes_of(words(1:size(words) - 1)))) status = 1
    end if
    if (status /= 0) then
      call refuse('cannot be read, is damaged, or is no checkpoint of biela')
    else if (words(2) /= program_digest()) then
      call refuse('was written by another version or build of biela')
    else if (words(3) /= digest(deck_text//settings)) then
      call refuse('belongs to another deck or other values of --set, or the deck has been changed since')
    else
      call a%begin_restoring(words(5:size(words) - 1))
    end if
  contains
    !> Says what is wrong with the checkpoint.
    subroutine refuse(what)
      character(*), intent(in) :: what
      call fail%raise(status_bad_input, 'the checkpoint in "'//folder//'" '//what// &
                      '; nothing has been changed; run without --restart to start at t = 0')
    end subroutine refuse
  end subroutine read_checkpoint

  !> Removes a checkpoint that no longer belongs to the results, if there is one.
  subroutine remove_checkpoint(folder)
    character(*), intent(in) :: folder
    call remove_own(folder//name)
    if (.not. is_others(folder//name//'.new')) call remove_scratch(folder//name//'.new')
  end subroutine remove_checkpoint
end module checkpoint
