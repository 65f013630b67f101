!> A library to be preloaded (LD_PRELOAD): counts what a program allocates and how often it factors a band matrix, and says
!> so on standard error when it ends. The tests assert with it that a step does neither.
module counters
  use, intrinsic :: iso_c_binding, only: c_ptr, c_funptr, c_size_t, c_int, c_long, c_char, c_double, c_intptr_t, &
                                         c_null_char, c_f_procpointer
  implicit none (type, external)
  private
  public :: count_malloc, count_calloc, count_realloc, count_dpbtrf, count_sincos, report_counts

  integer(c_long) :: allocations = 0, bytes = 0, factorisations = 0, angles = 0   !! since the start of the program

  abstract interface
    !> DPBTRF as C sees it.
    subroutine band_factoriser(uplo, n, kd, ab, ldab, info, length) bind(c)
      import :: c_ptr, c_size_t
      type(c_ptr), value :: uplo, n, kd, ab, ldab, info
      integer(c_size_t), value :: length
    end subroutine band_factoriser
    !> sincos(3).
    subroutine sine_and_cosine(x, s, c) bind(c)
      import :: c_double
      real(c_double), value :: x
      real(c_double), intent(out) :: s, c
    end subroutine sine_and_cosine
  end interface

  interface
    !> The C library's own malloc.
    function libc_malloc(n) bind(c, name='__libc_malloc') result(p)
      import :: c_ptr, c_size_t
      integer(c_size_t), value :: n
      type(c_ptr) :: p
    end function libc_malloc
    !> Its calloc.
    function libc_calloc(n, size) bind(c, name='__libc_calloc') result(p)
      import :: c_ptr, c_size_t
      integer(c_size_t), value :: n, size
      type(c_ptr) :: p
    end function libc_calloc
    !> Its realloc.
    function libc_realloc(old, n) bind(c, name='__libc_realloc') result(p)
      import :: c_ptr, c_size_t
      type(c_ptr), value :: old
      integer(c_size_t), value :: n
      type(c_ptr) :: p
    end function libc_realloc
    !> dlsym(3).
    function dlsym(handle, symbol) bind(c, name='dlsym') result(address)
      import :: c_intptr_t, c_char, c_funptr
      integer(c_intptr_t), value :: handle
      character(kind=c_char), intent(in) :: symbol(*)
      type(c_funptr) :: address
    end function dlsym
    !> write(2).
    function c_write(fd, text, n) bind(c, name='write') result(written)
      import :: c_int, c_char, c_size_t, c_long
      integer(c_int), value :: fd
      character(kind=c_char), intent(in) :: text(*)
      integer(c_size_t), value :: n
      integer(c_long) :: written
    end function c_write
  end interface

contains

  !> malloc, counted.
  function count_malloc(n) bind(c, name='malloc') result(p)
    integer(c_size_t), value :: n
    type(c_ptr) :: p
    allocations = allocations + 1
    bytes = bytes + n
    p = libc_malloc(n)
  end function count_malloc

  !> calloc, counted.
  function count_calloc(n, size) bind(c, name='calloc') result(p)
    integer(c_size_t), value :: n, size
    type(c_ptr) :: p
    allocations = allocations + 1
    bytes = bytes + n*size
    p = libc_calloc(n, size)
  end function count_calloc

  !> realloc, counted.
  function count_realloc(old, n) bind(c, name='realloc') result(p)
    type(c_ptr), value :: old
    integer(c_size_t), value :: n
    type(c_ptr) :: p
    allocations = allocations + 1
    bytes = bytes + n
    p = libc_realloc(old, n)
  end function count_realloc

  !> DPBTRF, counted.
  subroutine count_dpbtrf(uplo, n, kd, ab, ldab, info, length) bind(c, name='dpbtrf_')
    type(c_ptr), value :: uplo, n, kd, ab, ldab, info
    integer(c_size_t), value :: length
    integer(c_intptr_t), parameter :: next = -1
    procedure(band_factoriser), pointer :: original
    factorisations = factorisations + 1
    call c_f_procpointer(dlsym(next, 'dpbtrf_'//c_null_char), original)
    call original(uplo, n, kd, ab, ldab, info, length)
  end subroutine count_dpbtrf

  !> sincos, counted: the kinematics of frames take one for each.
  subroutine count_sincos(x, s, c) bind(c, name='sincos')
    real(c_double), value :: x
    real(c_double), intent(out) :: s, c
    integer(c_intptr_t), parameter :: next = -1
    procedure(sine_and_cosine), pointer, save :: original => null()
    angles = angles + 1
    if (.not. associated(original)) call c_f_procpointer(dlsym(next, 'sincos'//c_null_char), original)
    call original(x, s, c)
  end subroutine count_sincos

  !> Called when the program ends.
  subroutine report_counts() bind(c, name='report_counts')
    call say('allocations ', allocations)
    call say('bytes ', bytes)
    call say('factorisations ', factorisations)
    call say('angles ', angles)
  end subroutine report_counts

  !> Writes a name and a number without the help of any run-time library.
  subroutine say(name, number)
    character(*), intent(in) :: name
    integer(c_long), intent(in) :: number
    character(kind=c_char) :: text(40)
    integer(c_long) :: left
    integer :: k, i
    k = size(text)
    text(k) = achar(10)
    left = number
    do
      k = k - 1
      text(k) = achar(iachar('0') + int(mod(left, 10_c_long)))
      left = left/10
      if (left == 0) exit
    end do
    do i = len(name), 1, -1
      k = k - 1
      text(k) = name(i:i)
    end do
    if (c_write(2_c_int, text(k:), int(size(text) - k + 1, c_size_t)) < 0) return
  end subroutine say
end module counters
