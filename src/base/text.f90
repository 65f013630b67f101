!> Text utilities: case, numbers as text, lists of words, the nearest known word.
module text
  use kinds, only: wp, ip
  implicit none (type, external)
  private
  character(*), parameter, public :: digits = '0123456789', letters = 'abcdefghijklmnopqrstuvwxyz'
  public :: lower, to_text, es_text, short_text, exact_text, figure_text, fixed_text, joined, listed, in_quotes, either, quoted, &
    nearest_word, meant_word

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

  !> An integer of 64 bits without blanks, without a format: short decks need a thousand of them.
  pure function long_text(n) result(t)
    integer(ip), intent(in) :: n   !! any integer
    character(:), allocatable :: t
    integer(ip) :: rest
    t = ''
    rest = n
    do while (rest /= 0 .or. len(t) == 0)
      t = achar(iachar('0') + abs(mod(rest, 10_ip)))//t
      rest = rest/10
    end do
    if (n < 0) t = '-'//t
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

  !> The same without blanks in front.
  pure function short_text(x, decimals) result(t)
    real(wp), intent(in) :: x          !! any number [-]
    integer, intent(in) :: decimals    !! digits after the point, at least 1
    character(:), allocatable :: t
    t = trim(adjustl(es_text(x, decimals)))
  end function short_text

  !> A real in as few digits as give it back where they are read: 6, 15 or 17.
  pure function exact_text(x) result(t)
    real(wp), intent(in) :: x          !! any finite number [-]
    character(:), allocatable :: t
    integer, parameter :: figures(3) = [6, 15, 17]
    character(32) :: buffer
    real(wp) :: back, power
    integer :: k
    logical :: plain                   ! without an exponent
    plain = abs(x) >= 1.0e-3_wp .and. abs(x) < 1.0e6_wp
    t = real_text(x)
    do k = 1, size(figures) - 1
      if (plain) then                  ! a quotient of whole numbers is what would be read: both have less than 16 figures
        power = 10.0_wp**(figures(k) - 1 - floor(log10(abs(x))))
        back = anint(x*power)/power
      else
        read (t, *) back
      end if
      if (.not. abs(back - x) > 0.0_wp) exit
      if (plain) write (buffer, '(f32.'//to_text(figures(k + 1) - 1 - floor(log10(abs(x))))//')') x
      if (.not. plain) write (buffer, '(es32.'//to_text(figures(k + 1) - 1)//'e3)') x
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

  !> A real of a sentence: with two decimals, where these say enough.
  pure function figure_text(x) result(t)
    real(wp), intent(in) :: x          !! not negative [-]
    character(:), allocatable :: t
    t = short_text(x, 2)
    if (x >= 0.01_wp .and. x < 1.0e4_wp) t = fixed_text(x, 2)
  end function figure_text

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
      write (buffer, '(f20.'//to_text(5 - min(5, floor(log10(abs(x)))))//')') x
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

  !> Names in quotes, a blank before each: the end of a sentence.
  pure function in_quotes(names) result(t)
    character(*), intent(in) :: names(:)
    character(:), allocatable :: t
    t = ''
    if (size(names) > 0) t = ' "'//joined(names, '" "')//'"'
  end function in_quotes

  !> Two words or more in a sentence: a, b and c.
  pure function listed(words, before_last) result(t)
    character(*), intent(in) :: words(:)
    character(*), intent(in) :: before_last   !! `and` or `or`
    character(:), allocatable :: t
    integer :: n
    n = size(words)
    t = joined(words(:n - 1), ', ')//' '//before_last//' '//trim(words(n))
  end function listed

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

  !> Position in a list of the word nearest to a misspelt one. 0: no word differs by at most a third of the letters (or one
  !> letter).
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

  !> Position in a list of the word that is meant: the nearest one, else the first that begins with the word (`damp`: damping).
  !> 0: none.
  pure integer function meant_word(word, words) result(best)
    character(*), intent(in) :: word       !! misspelt word, any case
    character(*), intent(in) :: words(:)   !! known words, lower case
    integer :: letters
    letters = len_trim(word)
    best = nearest_word(word, words)
    if (best > 0 .or. letters < 3 .or. letters >= len(words)) return
    best = findloc(words(:)(:letters) == lower(word(:letters)), .true., 1)
  end function meant_word

  !> The first text where something is true, else the second.
  pure function either(first, second, true) result(t)
    character(*), intent(in) :: first, second
    logical, intent(in) :: true
    character(:), allocatable :: t
    t = second
    if (true) t = first
  end function either

  !> Text in quotes.
  pure function quoted(t) result(q)
    character(*), intent(in) :: t   !! any text
    character(:), allocatable :: q
    q = ''''//t//''''
  end function quoted
end module text
