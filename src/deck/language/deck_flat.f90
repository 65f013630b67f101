!> A deck as one text that runs alone: included files in their places, names with the prefixes of their parts, numbers in the
!> places of expressions, parameters with their values. Comments and layout stay as they are.
module deck_flat
  use growing_text, only: text_buffer
  use kinds, only: wp
  use readable_text, only: lf
  use text, only: exact_text, to_text
  use deck_keys, only: in_parameter
  use deck_paths, only: path_from
  use deck_cursor, only: group_cursor
  use deck_syntax, only: expression_value
  use posix, only: current_folder
  implicit none (type, external)
  private
  public :: flat_text

contains

  !> The text of a deck that has no faults.
  function flat_text(deck, names, values) result(text)
    class(group_cursor), intent(inout) :: deck !! with the values of its expressions
    character(*), intent(in) :: names(:)       !! of its parameters
    real(wp), intent(in) :: values(:)          !! their values [any]
    character(:), allocatable :: text
    type(text_buffer) :: flat
    integer :: parameters                      ! that stand before the present place
    parameters = 0
    call add_file(1)
    text = flat%all()
  contains
    !> Appends a file.
    recursive subroutine add_file(file)
      integer, intent(in) :: file              !! its number
      integer :: g, last                       ! group, last character that is done with
      last = 0
      associate (s => deck%parts%sources(file))
        do g = s%first_group, s%last_group
          associate (group => deck%parts%groups(g))
            if (group%included > 0) then
              call flat%add(s%text(last + 1:group%first - 2)//'! '//deck%parts%sources(group%included)%path//lf)
              call add_file(group%included)
              last = group%slash
            else if (group%kind == in_parameter) then
              parameters = parameters + 1
              call flat%add(s%text(last + 1:group%first - 2)//'&parameter name='''//trim(names(parameters))//''' value='// &
                number_text(values(parameters))//' /')
              last = group%slash
            else
              call add_group(file, g, last)
            end if
          end associate
        end do
        call flat%add(s%text(last + 1:))
      end associate
    end subroutine add_file

    !> Appends a group with what stands before it.
    subroutine add_group(file, g, last)
      integer, intent(in) :: file              !! number of its file
      integer, intent(in) :: g                 !! its number
      integer, intent(inout) :: last           !! last character of the file that is done with
      character(:), allocatable :: path
      integer :: a, v, i
      associate (s => deck%parts%sources(file), group => deck%parts%groups(g))
        do a = group%first_assignment, group%first_assignment + group%assignments - 1
          do v = deck%parts%assignments(a)%first_value, deck%parts%assignments(a)%first_value + deck%parts%assignments(a)%values - 1
            associate (token => deck%parts%values(v))
              if (token%copy) cycle
              if (token%form == expression_value) then
                call replace(s%text, token%first, token%last, number_text(token%number), last)
              else if (token%part > 0) then
                call replace(s%text, token%first, token%first - 1, deck%parts%sources(token%part)%prefix, last)
              else if (deck%parts%assignments(a)%name == 'file') then      ! a table's
                call deck%enter(g)
                path = table_path(deck%parts%sources(deck%home(token))%path, deck%word(token))
                do i = len(path), 1, -1                               ! a quote is doubled
                  if (path(i:i) == s%text(token%first - 1:token%first - 1)) path = path(:i)//path(i:)
                end do
                call replace(s%text, token%first, token%last, path, last)
              end if
            end associate
          end do
        end do
        call flat%add(s%text(last + 1:group%slash))
        last = group%slash
      end associate
    end subroutine add_group

    !> Appends a text in the place of characters of a file, with what stands before them.
    subroutine replace(text, first, through, new, last)
      character(*), intent(in) :: text, new
      integer, intent(in) :: first, through
      integer, intent(inout) :: last           !! last character of the file that is done with
      call flat%add(text(last + 1:first - 1)//new)
      last = through
    end subroutine replace
  end function flat_text

  !> The whole path of a table that a file names.
  function table_path(file, name) result(path)
    character(*), intent(in) :: file, name
    character(:), allocatable :: path
    path = path_from(file, name)
    if (index(path, '/') /= 1) path = current_folder()//path
  end function table_path

  !> A number in as few digits as give it back; a whole one as an integer, since a variable may ask for that.
  function number_text(x) result(text)
    real(wp), intent(in) :: x                  !! [any]
    character(:), allocatable :: text
    text = exact_text(x)
    if (abs(x) < huge(1) .and. abs(x - anint(x)) <= 0.0_wp) text = to_text(nint(x))
  end function number_text
end module deck_flat
