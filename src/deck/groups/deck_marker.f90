!> Markers on bodies: a node of a beam or frame, a point of a rigid body or of the ground, or the frame of a body.
module deck_marker
  use kinds, only: wp
  use text, only: to_text, quoted
  use deck_input, only: deck_source
  use deck_records, only: body_record, deck_record => deck, marker_record
  implicit none (type, external)
  private
  public :: check_marker, forbid_ground, forbid_rigid_pair, body_text

contains

  !> Checks where on its body a marker is, and finds its node.
  subroutine check_marker(deck, d, suffix, marker, frames)
    class(deck_source), intent(inout) :: deck
    type(deck_record), intent(in) :: d                   !! its bodies are read
    character(*), intent(in) :: suffix                   !! '', '_a', '_b' or '_c'
    type(marker_record), intent(inout) :: marker         !! as the deck gives it
    character(*), intent(in), optional :: frames         !! kinds for which no node means the body's frame
    integer :: node
    logical :: frame
    node = marker%node
    marker%node = 0
    if (.not. deck%is_set('body'//suffix)) then
      if (suffix == '' .or. suffix == '_a' .or. deck%is_given('body'//suffix)) return     ! reported as missing, or faulty
    end if
    if (.not. deck%choice_known .or. .not. deck%applies(deck%row_of('node'//suffix))) return
    frame = .false.
    if (present(frames)) frame = deck%is_choice(frames)
    if (marker%body == 0) then
      call check_point()
    else if (deck%body_known(marker%body)) then
      if (d%bodies(marker%body)%kind == 'rigid') then
        call check_point()
      else
        call check_node()
      end if
    end if
  contains
    !> A rigid body and the ground have points, no nodes.
    subroutine check_point()
      character(:), allocatable :: expected
      expected = 'point'//suffix//'=x,y'
      if (frame) expected = 'no node'
      if (deck%is_set('at'//suffix)) call deck%complain('at'//suffix, 'at'//suffix//' is a share of the length of a beam and '// &
        'does not apply to '//body_text(d, marker%body)//', expected '//expected)
      if (.not. deck%is_set('node'//suffix) .or. (frame .and. node == 0)) return
      call deck%complain('node'//suffix, 'node'//suffix//' does not apply to '//body_text(d, marker%body)//', which has '// &
        'no nodes, expected '//expected)
    end subroutine check_point

    !> A beam or frame has nodes; the last one may be called -1.
    subroutine check_node()
      character(:), allocatable :: expected
      associate (b => d%bodies(marker%body))
        expected = '1 to '//to_text(b%nodes)//' or -1 (the last)'
        if (frame) expected = '1 to '//to_text(b%nodes)//', -1 (the last) or 0 (the frame)'
        if (deck%is_set('point'//suffix)) then
          call deck%complain('point'//suffix, 'point'//suffix//' does not apply to '//body_text(d, marker%body)// &
            ', which has nodes, expected node'//suffix//' '//expected)
        else if (deck%is_given('at'//suffix)) then
          if (deck%is_set('at'//suffix)) call check_share(b)
        else if (deck%is_set('node'//suffix)) then
          marker%node = node
          if (node == -1) marker%node = b%nodes
          if (node > b%nodes .or. node < -1 .or. (node == 0 .and. .not. frame)) call deck%complain('node'//suffix, &
            'node'//suffix//'='//to_text(node)//' is out of range for '//body_text(d, marker%body)//', expected '//expected)
        else if (.not. (frame .or. deck%is_given('node'//suffix) .or. deck%is_given('point'//suffix))) then
          call deck%need('node'//suffix, 'a node of '//body_text(d, marker%body)//', '//expected)
        end if
      end associate
    end subroutine check_node

    !> A place given by its share of the length is a node.
    subroutine check_share(b)
      type(body_record), intent(in) :: b
      real(wp) :: whole                      ! elements up to there [-]
      real(wp) :: share                      ! of the length [-]
      share = marker%share
      marker%share = -1.0_wp
      if (deck%is_given('node'//suffix)) return
      if (b%kind /= 'beam') then
        call deck%complain('at'//suffix, 'at'//suffix//' is a share of the length of a beam and does not apply to '// &
          body_text(d, marker%body)//', expected node'//suffix)
      else
        whole = share*b%elements
        marker%node = 1 + nint(whole)
        if (abs(whole - nint(whole)) > 1.0e-9_wp*b%elements) call deck%complain('at'//suffix, 'at'//suffix//'='// &
          to_text(share)//' is no node of '//body_text(d, marker%body)//' with elements='//to_text(b%elements)// &
          ', expected a multiple of 1/'//to_text(b%elements))
      end if
    end subroutine check_share
  end subroutine check_marker

  !> A body in words: `beam 'rod'`, `the ground`.
  function body_text(d, body) result(t)
    type(deck_record), intent(in) :: d
    integer, intent(in) :: body   !! number of the body, 0: the ground
    character(:), allocatable :: t
    if (body == 0) then
      t = 'the ground'
    else if (d%bodies(body)%kind == 'rigid') then
      t = 'rigid body '//quoted(trim(d%bodies(body)%name))
    else
      t = trim(d%bodies(body)%kind)//' '//quoted(trim(d%bodies(body)%name))
    end if
  end function body_text

  !> Reports a reference to the ground where it makes no sense.
  subroutine forbid_ground(deck, name, body, why)
    class(deck_source), intent(inout) :: deck
    character(*), intent(in) :: name     !! variable that names the body
    integer, intent(in) :: body          !! number of the body it names
    character(*), intent(in) :: why      !! what is wrong
    if (deck%is_set(name) .and. body == 0) call deck%complain(name, name//'=''ground'' '//why// &
      ', expected the name of a &body')
  end subroutine forbid_ground

  !> Reports two markers that cannot move relative to each other: both on the ground or on one rigid body, or the same
  !> node or frame of one body.
  subroutine forbid_rigid_pair(deck, d, a, b, letter_a, letter_b)
    class(deck_source), intent(inout) :: deck
    type(deck_record), intent(in) :: d
    type(marker_record), intent(in) :: a, b  !! the two markers
    character(1), intent(in) :: letter_a, letter_b   !! with which their variables end
    character(:), allocatable :: marker
    if (a%body /= b%body .or. .not. (deck%is_known('body_'//letter_a) .and. deck%is_known('body_'//letter_b))) return
    if (letter_a == 'a' .and. .not. deck%is_set('body_a')) return      ! required, and reported as missing
    if (a%body == 0) then
      marker = 'on '//body_text(d, 0)
    else
      if (.not. deck%body_known(a%body)) return
      marker = 'on '//body_text(d, a%body)
      if (d%bodies(a%body)%kind /= 'rigid') then
        if (a%node /= b%node .or. .not. deck%is_clean()) return
        marker = 'node '//to_text(a%node)//' of '//body_text(d, a%body)
        if (a%node == 0) marker = 'the frame of '//body_text(d, a%body)
      end if
    end if
    call deck%complain('body_'//letter_b, 'markers '//letter_a//' and '//letter_b//' are '//marker//' and cannot move relative '// &
      'to each other, expected two bodies')
  end subroutine forbid_rigid_pair
end module deck_marker
