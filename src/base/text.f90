!> Text utilities: case, numbers as text, lists of words, the nearest known word, whole files.
module text
  use kinds, only: wp, ip
  implicit none (type, external)
  private
  public :: lower, to_text, es_text, exact_text, fixed_text, joined, nearest_word, read_file, word_hash, printable, quoted

  integer, parameter :: most_streamed = 20000000   !! longest deck read from a pipe; more is endless input [bytes]

  !> A number as text: integers in full, reals in as few digits as show them to 6 figures.
  interface to_text
    module procedure :: integer_text, long_text, real_text
  end interface to_text

contains

  !> ASCII letters in lower case; everything else as it is.
  pure function lower(s) result(t)
    character(*), intent(in) :: s   !! any text
    character(len(s)) :: t
    integer :: i, code
    do i = 1, len(s)
      code = iachar(s(i:i))
      if (code >= 65 .and. code <= 90) code = code + 32
      t(i:i) = achar(code)
    end do
  end function lower

  !> An integer without blanks.
  pure function integer_text(n) result(t)
    integer, intent(in) :: n   !! any integer
    character(:), allocatable :: t
    t = long_text(int(n, ip))
  end function integer_text

  !> An integer of 64 bits without blanks.
  pure function long_text(n) result(t)
    integer(ip), intent(in) :: n   !! any integer
    character(:), allocatable :: t
    character(20) :: buffer
    write (buffer, '(i0)') n
    t = trim(buffer)
  end function long_text

  !> A real as d.ddE+ee after a blank or minus sign, as d.dE+eee where the exponent needs it: always decimals + 7 characters.
  pure function es_text(x, decimals) result(t)
    real(wp), intent(in) :: x          !! any number [-]
    integer, intent(in) :: decimals    !! digits after the point, at least 1
    character(decimals + 7) :: t
    if (abs(x) > 0.0_wp .and. (abs(x) >= 9.99e99_wp .or. abs(x) < 1.0e-98_wp)) then
      write (t, '(es'//to_text(decimals + 7)//'.'//to_text(decimals - 1)//'e3)') x
    else
      write (t, '(es'//to_text(decimals + 7)//'.'//to_text(decimals)//')') x
    end if
  end function es_text

  !> A real in as few digits as give it back where they are read: 6, 15 or 17.
  pure function exact_text(x) result(t)
    real(wp), intent(in) :: x          !! any finite number [-]
    character(:), allocatable :: t
    integer, parameter :: digits(2) = [15, 17]
    character(32) :: buffer
    real(wp) :: back
    integer :: k
    t = real_text(x)
    do k = 1, size(digits)
      read (t, *) back
      if (.not. abs(back - x) > 0.0_wp) exit
      write (buffer, '(es32.'//to_text(digits(k) - 1)//'e3)') x
      if (abs(x) >= 1.0e-3_wp .and. abs(x) < 1.0e6_wp) &
        write (buffer, '(f32.'//to_text(digits(k) - 1 - floor(log10(abs(x))))//')') x
      t = trim(adjustl(buffer))
    end do
  end function exact_text

  !> A real with its integer part in full, without blanks; one of more than 9 digits as d.ddE+ee.
  pure function fixed_text(x, decimals) result(t)
    real(wp), intent(in) :: x          !! any number [-]
    integer, intent(in) :: decimals    !! digits after the point, at most 12
    character(:), allocatable :: t
    character(24) :: buffer
    buffer = es_text(x, decimals)
    if (abs(x) < 1.0e9_wp) write (buffer, '(f24.'//to_text(decimals)//')') x
    t = trim(adjustl(buffer))
  end function fixed_text

  !> A real to 6 figures, without blanks and without useless zeros: 0.35, -2, 1.5e-7.
  pure function real_text(x) result(t)
    real(wp), intent(in) :: x   !! any finite number [-]
    character(:), allocatable :: t
    character(24) :: buffer
    integer :: mark, power
    if (abs(x) <= 0.0_wp) then
      t = '0'
    else if (.not. abs(x) <= huge(x)) then
      t = 'no finite number'
    else if (abs(x) >= 1.0e-3_wp .and. abs(x) < 1.0e6_wp) then
      write (buffer, '(f20.'//to_text(5 - floor(log10(abs(x))))//')') x
      t = without_zeros(trim(adjustl(buffer)))
    else
      write (buffer, '(es14.5e3)') x
      mark = scan(buffer, 'E')
      read (buffer(mark + 1:), *) power
      t = without_zeros(trim(adjustl(buffer(:mark - 1))))//'e'//to_text(power)
    end if
  end function real_text

  !> A decimal fraction without its trailing zeros and a trailing point.
  pure function without_zeros(s) result(t)
    character(*), intent(in) :: s   !! digits with a decimal point
    character(:), allocatable :: t
    integer :: last
    last = verify(s, '0', back=.true.)
    if (s(last:last) == '.') last = last - 1
    t = s(1:last)
  end function without_zeros

  !> Words of a list, blanks at their ends removed, with a separator between them; in linear time, since there may be a million.
  pure function joined(words, separator) result(t)
    character(*), intent(in) :: words(:)    !! the words
    character(*), intent(in) :: separator   !! what stands between two of them
    character(:), allocatable :: t
    integer :: k, n, last
    allocate (character(sum(len_trim(words)) + len(separator)*max(0, size(words) - 1)) :: t)
    n = 0
    do k = 1, size(words)
      last = n + len_trim(words(k))
      t(n + 1:last) = words(k)
      n = last + len(separator)
      if (k < size(words)) t(last + 1:n) = separator
    end do
  end function joined

  !> How many letters must be changed, added, dropped or swapped with their neighbour to turn `a` into `b`
  !> (optimal string alignment distance).
  pure integer function edit_distance(a, b) result(distance)
    character(*), intent(in) :: a, b   !! words of the same case, without blanks at their ends
    integer :: row(0:len(b), 0:2)      ! the rows i, i-1 and i-2 of the table
    integer :: i, j
    row(:, 0) = [(j, j=0, len(b))]
    row(:, 1) = 0
    do i = 1, len(a)
      row(:, 2) = row(:, 1)
      row(:, 1) = row(:, 0)
      row(0, 0) = i
      do j = 1, len(b)
        row(j, 0) = min(row(j, 1) + 1, row(j - 1, 0) + 1, row(j - 1, 1) + merge(0, 1, a(i:i) == b(j:j)))
        if (i < 2 .or. j < 2) cycle
        if (a(i:i) /= b(j - 1:j - 1) .or. a(i - 1:i - 1) /= b(j:j)) cycle
        row(j, 0) = min(row(j, 0), row(max(j - 2, 0), 2) + 1)
      end do
    end do
    distance = row(len(b), 0)
  end function edit_distance

  !> Position in a list of the word nearest to a misspelt one, 0 if none is near enough to be meant: within a third of the
  !> letters, at least one.
  pure integer function nearest_word(word, words) result(best)
    character(*), intent(in) :: word       !! misspelt word, any case
    character(*), intent(in) :: words(:)   !! known words, lower case
    integer :: k, distance, least, letters
    letters = len_trim(word)
    best = 0
    least = merge(letters, max(1, (letters + 1)/3) + 1, letters < 3)
    do k = 1, size(words)
      if (abs(len_trim(words(k)) - letters) >= least) cycle
      distance = edit_distance(lower(trim(word)), lower(trim(words(k))))
      if (distance >= least) cycle
      least = distance
      best = k
    end do
  end function nearest_word

  !> A number in 0..2147483647 that equal words share, blanks at the end not counted.
  pure integer function word_hash(word) result(hash)
    character(*), intent(in) :: word   !! lower case word
    integer(ip) :: h
    integer :: i
    h = 5381_ip
    do i = 1, len_trim(word)
      h = iand(33_ip*h + iachar(word(i:i)), 2147483647_ip)
    end do
    hash = int(h)
  end function word_hash

  !> Text as it may be shown in a one-line message: control characters as `?`, cut after `most` characters.
  pure function printable(s, most) result(t)
    character(*), intent(in) :: s     !! any text
    integer, intent(in) :: most       !! longest text wanted
    character(:), allocatable :: t
    integer :: i, last
    last = len(s)
    if (last > most) then
      last = most
      do while (last > 1 .and. iachar(s(last + 1:last + 1)) >= 128 .and. iachar(s(last + 1:last + 1)) < 192)
        last = last - 1               ! not in the middle of a multi-byte character
      end do
    end if
    t = s(1:last)
    do i = 1, last
      if (iachar(t(i:i)) < 32 .or. iachar(t(i:i)) == 127) t(i:i) = '?'
    end do
    if (last < len(s)) t = t//'...'
  end function printable

  !> Text in quotes.
  pure function quoted(t) result(q)
    character(*), intent(in) :: t   !! any text
    character(:), allocatable :: q
    q = ''''//t//''''
  end function quoted

  !> A whole file with line feeds as its only line ends (CR LF and lone CR become LF), always with one at the end; a
  !> byte order mark is dropped. `problem` is empty if the file could be read.
  subroutine read_file(path, content, problem)
    character(*), intent(in) :: path                       !! file name
    character(:), allocatable, intent(out) :: content      !! its text
    character(:), allocatable, intent(out) :: problem      !! why it could not be read
    character(:), allocatable :: raw
    character(200) :: reason
    integer :: unit, status, bytes
    content = ''
    problem = ''
    reason = ''
    raw = ''
    open (newunit=unit, file=path, status='old', action='read', access='stream', form='unformatted', &
      iostat=status, iomsg=reason)
    if (status /= 0) then
      problem = plain_reason(reason)
      return
    end if
    inquire (unit=unit, size=bytes)
    if (bytes < 0) then
      problem = 'not an ordinary file'
    else
      raw = repeat(' ', bytes)
      if (bytes > 0) read (unit, iostat=status, iomsg=reason) raw
      if (status /= 0) problem = plain_reason(reason)
      if (bytes == 0) call read_stream(unit, raw, problem)
    end if
    close (unit)
    if (len(problem) == 0) call normalize(raw, content)
  end subroutine read_file

  !> All that a file without a known size holds (a pipe, standard input), up to a length beyond which the input counts as endless.
  subroutine read_stream(unit, raw, problem)
    integer, intent(in) :: unit                            !! open for unformatted stream access
    character(:), allocatable, intent(inout) :: raw        !! its bytes
    character(:), allocatable, intent(inout) :: problem    !! why it could not be read
    character :: byte
    integer :: n, status
    n = 0
    do
      read (unit, iostat=status) byte
      if (status /= 0) exit
      if (n == most_streamed) then
        problem = 'endless or too long'
        return
      end if
      if (n == len(raw)) raw = raw//repeat(' ', max(65536, n))
      n = n + 1
      raw(n:n) = byte
    end do
    raw = raw(1:n)
  end subroutine read_stream

  !> The last part of a run-time message such as `Cannot open file 'x': No such file or directory`.
  pure function plain_reason(message) result(reason)
    character(*), intent(in) :: message   !! message of the run-time library
    character(:), allocatable :: reason
    integer :: colon
    colon = index(message, ': ', back=.true.)
    reason = trim(message(colon + merge(2, 1, colon > 0):))
    if (len(reason) == 0) reason = 'cannot be read'
    reason = lower(reason(1:1))//reason(2:)
  end function plain_reason

  !> Line feeds as the only line ends, one at the end, no byte order mark.
  pure subroutine normalize(raw, content)
    character(*), intent(in) :: raw                      !! bytes of a file
    character(:), allocatable, intent(out) :: content    !! the same text
    character(*), parameter :: cr = achar(13), lf = achar(10)
    character(*), parameter :: mark = char(239)//char(187)//char(191)   ! UTF-8
    integer :: i, n
    allocate (character(len(raw) + 1) :: content)
    n = 0
    do i = 1, len(raw)
      if (raw(i:i) == lf .and. i > 1) then
        if (raw(i - 1:i - 1) == cr) cycle
      end if
      n = n + 1
      content(n:n) = merge(lf, raw(i:i), raw(i:i) == cr)
    end do
    if (n > 0) then
      if (content(n:n) /= lf) n = n + 1
      content(n:n) = lf
    end if
    content = content(1:n)
    if (index(content, mark) == 1) content = content(4:)
  end subroutine normalize
end module text
